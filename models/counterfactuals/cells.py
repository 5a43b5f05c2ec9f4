"""The cells of an observation between the cuts of a policy, and moves to one or two of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

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


Chosen = dict[int, int]
"""Cells that are moved to, by the place of their observation among the free ones."""


def nearest_single(cells: Sequence[Cells], gains: Sequence[Array], need: float) -> Chosen | None:
    """Returns the nearest single move that gains enough, or None.

    Args:
        cells: Cells of each free observation (k).
        gains: What each cell gains alone (k arrays).
        need: What must be gained.
    """
    found: tuple[float, Chosen | None] = (np.inf, None)
    for place, (own, gain) in enumerate(zip(cells, gains, strict=True)):
        squared = np.where(gain >= need, own.squared, np.inf)
        best = int(squared.argmin())
        if squared[best] < found[0]:
            found = float(squared[best]), {place: best}
    return found[1]


def nearest_pair(
    cells: Sequence[Cells],
    gains: Sequence[Array],
    need: float,
    extra: Mapping[tuple[int, int], Array],
) -> Chosen | None:
    """Returns the nearest two moves that gain enough together, or None.

    Args:
        cells: Cells of each free observation (k).
        gains: What each cell gains alone (k arrays).
        need: What must be gained.
        extra: What two cells gain together beyond that, of the pairs of observations where there
            is such.
    """
    found: tuple[float, Chosen | None] = (np.inf, None)
    fronts = [_front(own, gain) for own, gain in zip(cells, gains, strict=True)]
    for first, second in combinations(range(len(cells)), 2):
        own = extra.get((first, second))
        rows, columns = fronts[first], fronts[second]
        if own is not None:
            rows, columns = (np.arange(len(gains[place])) for place in (first, second))
        gain = gains[first][rows, None] + gains[second][columns]
        if own is not None:
            gain = gain + own
        squared = cells[first].squared[rows, None] + cells[second].squared[columns]
        squared = np.where(gain >= need, squared, np.inf)
        best = np.unravel_index(squared.argmin(), squared.shape)
        if squared[best] < found[0]:
            found = float(squared[best]), {first: int(rows[best[0]]), second: int(columns[best[1]])}
    return found[1]


def _front(cells: Cells, gain: Array) -> NDArray[np.intp]:
    """Returns the cells that gain more than any that is as near."""
    order = np.lexsort((-gain, cells.squared))
    most = np.maximum.accumulate(gain[order])
    return order[np.flatnonzero(np.diff(most, prepend=-np.inf) > 0)]
