"""Branch and bound: the greatest value of a function over boxes, bounded from above."""

from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array


@dataclass(frozen=True)
class Cells:
    """Boxes of a search, one a row.

    Attributes:
        lower: Least coordinates (m, n).
        upper: Greatest coordinates (m, n).
        bound: What no value in a cell is greater than (m).
        label: A number of the search's own (m).
    """

    lower: Array
    upper: Array
    bound: Array
    label: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.bound)

    def __getitem__(self, which: NDArray[np.bool_]) -> Self:
        return type(self)(*(column[which] for column in vars(self).values()))

    def joined(self, other: Self) -> Self:
        """Returns these cells, then others."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return type(self)(*(np.concatenate(pair) for pair in pairs))


class Search(Protocol):
    """What branch and bound asks about a function.

    Attributes:
        reached: The greatest value that was found so far.
    """

    reached: float

    def enough(self, greatest: float) -> float:
        """Returns the bound up to which cells are searched no further; infinite to give up.

        Args:
            greatest: The greatest bound of the cells that are left.
        """
        ...

    def split(self, cells: Cells) -> tuple[Cells, float]:
        """Splits cells, and perhaps finds a greater value.

        Returns:
            The parts, and the greatest bound of cells that cannot be split; -inf without such.
        """
        ...


def greatest_bound(search: Search, cells: Cells, *, at_once: int) -> float:
    """Bounds the greatest value in cells, by splitting those first whose bounds are greatest.

    Args:
        search: The function.
        cells: The cells to begin with.
        at_once: How many cells are split at once.
    """
    closed = -np.inf
    while len(cells):
        done = cells.bound <= search.enough(float(cells.bound.max()))
        closed = max(closed, cells.bound[done].max(initial=-np.inf))
        cells = cells[~done]
        if not len(cells):
            break
        first = np.zeros(len(cells), dtype=bool)
        first[np.argsort(-cells.bound, kind="stable")[:at_once]] = True
        parts, stuck = search.split(cells[first])
        closed, cells = max(closed, stuck), cells[~first].joined(parts)
    return float(max(closed, search.reached))
