"""The nearest answer that changes one observation or two, of tables of gains."""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.cells import Cells

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
