"""Colours of the reward machine's states, by Okabe and Ito: safe for colour-blind readers.

How far two colours stand apart is WCAG's contrast ratio: 4.5 at least for text, 3 for marks.
"""

from itertools import cycle

from glassgait.models.task.gait import Gait

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")

INK, GROUND = "#1b1f24", "#ffffff"
"""Text on a page, and the page."""

FAULT_COLORS = ("#999999", "#BBBBBB", "#777777")
"""Greys: states at fault are no part of the gait."""


def state_colors(gait: Gait) -> tuple[str, ...]:
    """Returns the colour of each state of a gait's machine, as hexadecimal red, green and blue."""
    sound, faulty = cycle(COLORS), cycle(FAULT_COLORS)
    return tuple(next(faulty if state in gait.faults else sound) for state in gait.states)


def contrast(first: str, second: str) -> float:
    """Returns the contrast ratio of two colours, given as #rrggbb: 1 to 21 (WCAG 2.2)."""
    dark, light = sorted((_luminance(first), _luminance(second)))
    return (light + 0.05) / (dark + 0.05)


def ink_on(color: str) -> str:
    """Returns the colour of text, black or white, that can be read better on a colour."""
    return max(("#ffffff", "#000000"), key=lambda ink: contrast(ink, color))


def _luminance(color: str) -> float:
    channels = [int(color[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    red, green, blue = (
        value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
        for value in channels
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
