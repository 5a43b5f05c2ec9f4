"""Bounds the maximum of a polynomial of observed quantities over a box, and finds a witness."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.certificates.polynomial import Relaxation

MOST_CELLS, SPLIT_AT_ONCE = 500, 64
"""Cells at which a search stops with a valid but looser bound, and cells that are split at once."""

STARTS, SWEEPS, INNER_POINTS = 16, 6, 9
"""Start points of the search for a witness, its sweeps over the quantities, and the values that it
tries of a curved quantity. Of others it tries the ends, where affine functions have their maximum.
"""

Tree = list
"""A split: [quantity, cut, tree below, tree above]; an empty list is a cell without splits."""


@dataclass(frozen=True)
class Region:
    """A box of quantities (n), in the robot's units; those with an index in `counted` are whole."""

    lower: Array
    upper: Array
    counted: frozenset[int] = frozenset()

    def with_copy(self, index: int) -> "Region":
        """Returns the box with one more quantity, a second value of the quantity at `index`."""
        counted = self.counted | ({len(self.lower)} if index in self.counted else frozenset())
        lower, upper = (np.append(ends, ends[index]) for ends in (self.lower, self.upper))
        return Region(lower, upper, counted)


@dataclass(frozen=True)
class Maximum:
    """Bounds of a function's maximum over a box.

    `bound` is an upper bound over the cells of `splits`; the witness (n) has the value `reached`.
    """

    bound: float
    reached: float
    witness: Array
    splits: Tree = field(default_factory=list)


class _Cells(NamedTuple):
    """Boxes of the search, one per row: corners (m, n), bounds and numbers of tree nodes (m)."""

    lower: Array
    upper: Array
    bound: Array
    node: NDArray[np.intp]

    def where(self, mask: NDArray[np.bool_]) -> "_Cells":
        return _Cells(self.lower[mask], self.upper[mask], self.bound[mask], self.node[mask])

    def joined(self, other: "_Cells") -> "_Cells":
        columns: Any = map(np.concatenate, zip(self, other, strict=True))
        return _Cells(*columns)


def maximize(
    function: Callable[[Array], Array],
    relaxation: Relaxation,
    region: Region,
    *,
    gap: float,
    threshold: float | None = None,
) -> Maximum:
    """Bounds the greatest value of a function over a box, by branch and bound.

    Args:
        function: Evaluates the function (m,) of quantities (m, n).
        gap: Difference of bound and witness at which the search ends.
        threshold: Ends the search once the bound is at most this number, or the witness above it.
    """
    search = _Search(function, relaxation, region)
    lower, upper = region.lower[None], region.upper[None]
    cells = _Cells(lower, upper, relaxation.upper(lower, upper), np.zeros(1, dtype=np.intp))
    closed = -np.inf
    while len(cells.bound):
        # Close the cells whose bounds are low enough; all of them once there are too many.
        enough = search.reached + gap
        if threshold is not None:
            enough = np.inf if search.reached > threshold else max(threshold, enough)
        done = cells.bound <= (np.inf if search.n_cells >= MOST_CELLS else enough)
        closed = max(closed, cells.bound[done].max(initial=-np.inf))
        cells = cells.where(~done)
        if not len(cells.bound):
            break
        # Split the cells with the greatest bounds.
        first = np.zeros(len(cells.bound), dtype=bool)
        first[np.argsort(-cells.bound, kind="stable")[:SPLIT_AT_ONCE]] = True
        halves, stuck = search.split(cells.where(first))
        closed, cells = max(closed, stuck), cells.where(~first).joined(halves)
    bound = float(max(closed, search.reached))
    return Maximum(bound, float(search.reached), search.witness, search.nodes[0])


class _Search:
    """Searches for the maximum; `nodes` lists the nodes of the tree of splits, the root first."""

    def __init__(
        self, function: Callable[[Array], Array], relaxation: Relaxation, region: Region
    ) -> None:
        self._function, self._relaxation, self._region = function, relaxation, region
        self._generator = np.random.default_rng(0)
        self.witness, self.reached = self._ascended(self._starts(region, STARTS))
        self.nodes: list[Tree] = [[]]
        self.n_cells = self._climbs_at = 1

    def split(self, cells: _Cells) -> tuple[_Cells, float]:
        """Halves cells; returns halves, and the greatest bound of cells that cannot be split."""
        # Without shared quantities no split lowers a bound.
        shared, n = self._relaxation.shared, cells.lower.shape[1]
        if self.n_cells >= self._climbs_at:
            self._climb(Region(cells.lower[0], cells.upper[0]))
        if not shared:
            return cells.where(np.zeros(len(cells.bound), dtype=bool)), float(cells.bound.max())

        # Halve every cell by each quantity; counts stay whole. Corners are (k, 2, m, n).
        lower, upper = (
            np.tile(ends, (len(shared), 2, 1, 1)) for ends in (cells.lower, cells.upper)
        )
        for k, index in enumerate(shared):
            is_counted = index in self._region.counted
            middle = 0.5 * (cells.lower + cells.upper)[:, index]
            upper[k, 0, :, index] = np.floor(middle) if is_counted else middle
            lower[k, 1, :, index] = np.floor(middle) + 1.0 if is_counted else middle
        bounds = self._relaxation.upper(lower.reshape(-1, n), upper.reshape(-1, n))
        bounds = bounds.reshape(len(shared), 2, -1)

        # Choose the quantity that lowers the bounds of both halves most.
        k = np.arange(len(shared))
        ends = upper[k, 0, :, shared], lower[k, 1, :, shared]
        width = (cells.upper - cells.lower)[:, shared].T
        lowered = cells.bound - bounds
        gains = lowered.min(axis=1) + 0.3 * lowered.max(axis=1) + 1e-9 * width
        can_split = (ends[0] < cells.upper[:, shared].T) & (ends[1] > cells.lower[:, shared].T)
        gains = np.where(can_split, gains, -np.inf)
        splits = gains.max(axis=0) > -np.inf
        stuck = cells.bound[~splits].max(initial=-np.inf)

        # Cut the cells there.
        row = np.flatnonzero(splits)
        best = gains.argmax(axis=0)[row]
        cuts = 0.5 * (ends[0] + ends[1])[best, row]
        nodes = [
            self._cut(node, shared[k], cut)
            for node, k, cut in zip(cells.node[row], best, cuts.tolist(), strict=True)
        ]
        self.n_cells += len(row)
        halves = _Cells(
            lower[best, :, row].reshape(-1, n),
            upper[best, :, row].reshape(-1, n),
            bounds[best, :, row].ravel(),
            np.array(nodes, dtype=np.intp).ravel(),
        )
        return halves, float(stuck)

    def _cut(self, node: int, index: int, cut: float) -> tuple[int, int]:
        """Splits a node of the tree, and returns the numbers of its children."""
        below, above = [], []
        self.nodes[node][:] = [index, cut, below, above]
        self.nodes += [below, above]
        return len(self.nodes) - 2, len(self.nodes) - 1

    def _climb(self, cell: Region) -> None:
        """Looks for a better witness from points in a cell, less often as cells become many."""
        self._climbs_at = 2 * self.n_cells
        witness, value = self._ascended(self._starts(cell, STARTS // 4))
        if value > self.reached:
            self.witness, self.reached = witness, value

    def _starts(self, cell: Region, count: int) -> Array:
        """Returns a cell's centre, and random points with coordinates at ends or middles."""
        ends = self._generator.integers(0, 3, (count, len(cell.lower))) / 2.0
        points = cell.lower + ends * (cell.upper - cell.lower)
        points[0] = 0.5 * (cell.lower + cell.upper)
        counted = list(self._region.counted)
        # Middles of counts are rounded down.
        points[:, counted] = np.floor(points[:, counted])
        return points

    def _ascended(self, points: Array) -> tuple[Array, float]:
        """Climbs from points, one quantity at a time; returns the highest point and its value."""
        relaxation = self._relaxation
        points = np.clip(points, self._region.lower, self._region.upper)
        values = self._function(points)
        for _ in range(SWEEPS):
            before = values.copy()
            for index in relaxation.used:
                # Try several values of the quantity at each point, and keep the best.
                tried = self._values_of(index)
                moved = np.repeat(points[:, None], len(tried), axis=1)
                moved[:, :, index] = tried
                heights = self._function(moved.reshape(-1, moved.shape[-1]))
                heights = heights.reshape(len(points), -1)
                heights = np.where(np.isnan(heights), -np.inf, heights)
                best = np.arange(len(points)), np.argmax(heights, axis=1)
                better = heights[best] > values
                points = np.where(better[:, None], moved[best], points)
                values = np.where(better, heights[best], values)
            if np.all(values <= before + 1e-12):
                break
            highest = np.argsort(-values, kind="stable")[:STARTS]
            points, values = points[highest], values[highest]
        best = int(np.argmax(values))
        return points[best], float(values[best])

    def _values_of(self, index: int) -> Array:
        low, high = self._region.lower[index], self._region.upper[index]
        if index in self._region.counted:
            return np.arange(low, high + 1.0)
        return np.linspace(low, high, INNER_POINTS if index in self._relaxation.curved else 2)
