"""The cells of an observation between the cuts that a policy makes, and how far each is."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.question import Question

_INSIDE = 1e-6
"""How far inside a cell, from its edge, an observation is put (spreads)."""


@dataclass(frozen=True)
class Cells:
    """The cells of one free observation.

    Attributes:
        index: Which observation.
        values: A value in each cell, close to the nearest (c).
        squared: Squared distance of each cell from what was observed (c, in spreads).
        here: The cell of what was observed.
    """

    index: int
    values: Array
    squared: Array
    here: int

    def __getitem__(self, kept: NDArray[np.intp]) -> "Cells":
        here = int(np.flatnonzero(kept == self.here)[0])
        return Cells(self.index, self.values[kept], self.squared[kept], here)

    def within(self, squared: float) -> "Cells":
        """Leaves the cells that are no farther."""
        return self[np.flatnonzero(self.squared <= squared)]


def cells_of(question: Question, cuts: Sequence[Array]) -> list[Cells]:
    """Cuts every free observation into cells, within its range.

    Args:
        question: The question.
        cuts: Cuts of every observation (n arrays), in any order; what lies between two of them has
            the same action.
    """
    return [_cells(question, int(index), cuts[index]) for index in question.room.free]


def _cells(question: Question, index: int, cuts: Array) -> Cells:
    room, observed = question.room, question.observation[index]
    low, high = min(room.lower[index], observed), max(room.upper[index], observed)
    inner = np.unique(cuts[(cuts > low) & (cuts < high)])
    left, right = np.append(low, inner), np.append(inner, high)
    inside = np.minimum(_INSIDE * room.spread[index], 0.5 * (right - left))
    values = np.clip(observed, left + inside, right - inside)
    squared = (np.clip(observed, left, right) - observed) ** 2 / room.spread[index] ** 2
    here = int(np.searchsorted(inner, observed))
    # What was observed may lie on a cut itself, and belongs to one side: the policy knows which.
    values[here] = observed
    return Cells(index, values, squared, here)
