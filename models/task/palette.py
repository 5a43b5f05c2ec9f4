"""Colours of the reward machine's states, by Okabe and Ito: safe for colour-blind readers."""

from itertools import cycle

from glassgait.models.task.gait import Gait

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")

FAULT_COLORS = ("#999999", "#BBBBBB", "#777777")
"""Greys: states at fault are no part of the gait."""


def state_colors(gait: Gait) -> tuple[str, ...]:
    """Returns the colour of each state of a gait's machine, as hexadecimal red, green and blue."""
    sound, faulty = cycle(COLORS), cycle(FAULT_COLORS)
    return tuple(next(faulty if state in gait.faults else sound) for state in gait.states)
