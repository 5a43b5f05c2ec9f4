"""The robot's own remote, whose 40 bytes come within LowState.

Their layout is that of Unitree's `unitree_joystick.h` and of `utils/joystick.py` of its SDK for
Python: two bytes, 16 buttons as bits, and the sticks lx, rx, ry, the trigger L2, and ly as floats;
what follows is unused.
"""

import math
import struct
from dataclasses import dataclass
from enum import IntFlag
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Lt

from glassgait.models.link.unitree_messages import N_REMOTE
from glassgait.models.settings import Settings
from glassgait.models.task.command import Command, CommandRange
from glassgait.models.task.day import REQUESTS

_LAYOUT = struct.Struct("<2xH5f")


class Button(IntFlag):
    """Buttons, by their bit."""

    R1 = 1 << 0
    L1 = 1 << 1
    START = 1 << 2
    SELECT = 1 << 3
    R2 = 1 << 4
    L2 = 1 << 5
    F1 = 1 << 6
    F2 = 1 << 7
    A = 1 << 8
    B = 1 << 9
    X = 1 << 10
    Y = 1 << 11
    UP = 1 << 12
    RIGHT = 1 << 13
    DOWN = 1 << 14
    LEFT = 1 << 15


DAMP = Button.L2 | Button.B
"""Held together they damp the robot, as with Unitree's own controller."""


REQUESTED_BY = dict(zip(REQUESTS, (Button.SELECT, Button.A, Button.START), strict=True))
"""The button that requests each mode of a day."""


@dataclass(frozen=True)
class Sticks(Settings):
    """How the remote's sticks command.

    Attributes:
        dead_zone: Share of a stick's way from its middle that commands nothing.
    """

    title: ClassVar[str] = "sticks"

    dead_zone: Annotated[float, Ge(0.0), Lt(1.0)] = 0.1


class Remote(NamedTuple):
    """What the remote's operator does.

    Attributes:
        buttons: What is pressed.
        lx: Left stick to the right, -1 to 1.
        ly: Left stick forward.
        rx: Right stick to the right.
        ry: Right stick forward.
    """

    buttons: Button
    lx: float
    ly: float
    rx: float
    ry: float

    @classmethod
    def untouched(cls) -> "Remote":
        """Returns a remote that is not touched."""
        return cls(Button(0), 0.0, 0.0, 0.0, 0.0)

    @property
    def asks_to_damp(self) -> bool:
        """Whether L2 and B are held."""
        return self.buttons & DAMP == DAMP


def read_remote(data: bytes) -> Remote:
    """Reads the remote's bytes (40). A stick that is not finite is at its middle.

    Raises:
        ValueError: if there are not 40 bytes.
    """
    if len(data) != N_REMOTE:
        raise ValueError(f"a remote has {N_REMOTE} bytes, not {len(data)}")
    buttons, *sticks = _LAYOUT.unpack_from(data)
    lx, rx, ry, _, ly = (
        min(max(stick, -1.0), 1.0) if math.isfinite(stick) else 0.0 for stick in sticks
    )
    return Remote(Button(buttons), lx=lx, ly=ly, rx=rx, ry=ry)


def write_remote(remote: Remote) -> bytes:
    """Returns the remote's bytes (40)."""
    sticks = (remote.lx, remote.rx, remote.ry, 0.0, remote.ly)
    return _LAYOUT.pack(int(remote.buttons), *sticks).ljust(N_REMOTE, b"\x00")


def requested_mode(now: Remote, before: Remote, requested: int) -> int:
    """Returns the number of what the operator requests of a day.

    Args:
        now: What the operator does. Of several buttons that are held the first request counts: to
            sit before to stand, and that before to walk.
        before: What the operator did a control step before: a button counts once.
        requested: What was requested so far, and still is where no button is newly pressed.
    """
    for number, name in enumerate(REQUESTS):
        if REQUESTED_BY[name] in now.buttons:
            return requested if REQUESTED_BY[name] in before.buttons else number
    return requested


def remote_command(remote: Remote, limits: CommandRange, settings: Sticks, dwell: float) -> Command:
    """Returns the command of the sticks: the left one forward, the right one to turn.

    Args:
        remote: What the operator does.
        limits: Its greatest speed and yaw rate are those of a stick at its end.
        settings: How sticks command.
        dwell: The rhythm, which the remote does not command (control steps).
    """
    forward, left = (_beyond(stick, settings.dead_zone) for stick in (remote.ly, -remote.rx))
    velocity = np.array([forward * limits.max_speed, left * limits.max_yaw_rate])
    return Command(velocity, np.array(dwell))


def _beyond(stick: float, dead_zone: float) -> float:
    """Returns a stick's share of its way beyond the dead zone, with its sign."""
    return math.copysign(max(abs(stick) - dead_zone, 0.0) / (1.0 - dead_zone), stick)
