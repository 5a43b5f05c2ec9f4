"""A gamepad as a browser reports it, read as if it were the robot's own remote.

Axes and buttons are numbered as in the W3C's `standard` layout of gamepads: axes left stick to the
right and back, right stick to the right and back; buttons below, right, left, above, and so on.
"""

import math
from collections.abc import Sequence

from glassgait.models.link.remote import Button, Remote

BUTTONS = (
    Button.A,
    Button.B,
    Button.X,
    Button.Y,
    Button.L1,
    Button.R1,
    Button.L2,
    Button.R2,
    Button.SELECT,
    Button.START,
    Button.F1,
    Button.F2,
    Button.UP,
    Button.DOWN,
    Button.LEFT,
    Button.RIGHT,
)
"""What each button is on the remote, by its number; F1 and F2 are the sticks pressed."""

PRESSED = 0.5
"""How far a button is pressed from which it counts, of 1."""

N_AXES = 4


def read_gamepad(axes: Sequence[float], buttons: Sequence[float]) -> Remote:
    """Returns what a gamepad's operator does.

    Args:
        axes: The sticks, -1 to 1; those that are missing or not finite are at their middle.
        buttons: How far buttons are pressed, 0 to 1; those that are missing are not.
    """
    sticks = [min(max(axis, -1.0), 1.0) if math.isfinite(axis) else 0.0 for axis in axes]
    right, back, other_right, other_back = (*sticks, *N_AXES * (0.0,))[:N_AXES]
    pressed = Button(0)
    for value, button in zip(buttons, BUTTONS, strict=False):
        if value >= PRESSED:
            pressed |= button
    return Remote(pressed, lx=right, ly=-back, rx=other_right, ry=-other_back)


def requested_gait(now: Remote, before: Remote, running: int, n_gaits: int) -> int:
    """Returns the number of the gait that is requested: R1 the next one, L1 the one before.

    Args:
        now: What the operator does.
        before: What the operator did a control step before: a button counts once.
        running: The gait that is requested so far.
        n_gaits: Number of gaits; after the last comes the first.
    """
    newly = now.buttons & ~before.buttons
    onward = int(Button.R1 in newly) - int(Button.L1 in newly)
    return (running + onward) % n_gaits
