"""The greatest value of a polynomial of observed quantities over a box, and a witness of it."""

from collections.abc import Callable, Collection
from itertools import product

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.branch_and_bound import Cells, greatest_bound
from glassgait.models.certificates.question import Box, Maximum, Tree
from glassgait.models.certificates.relaxation import Relaxation

MOST_CELLS = 500
"""Cells of a search that gives up: its bound holds, and is less tight."""

SPLIT_AT_ONCE = 64

STARTS = 16
SWEEPS = 6
"""How a witness is sought: from the best starts, quantity by quantity, as often."""

MOST_GATES = 6
"""Quantities whose ends are combined in all ways to start from."""

INNER_POINTS = 9
"""Values of a curved quantity that are tried; of others the ends, where affine functions peak."""


def maximize(
    function: Callable[[Array], Array],
    relaxation: Relaxation,
    region: Box,
    *,
    gap: float,
    threshold: float | None = None,
) -> Maximum:
    """Bounds the greatest value of a function over a box.

    Args:
        function: Evaluates the function (m,) of quantities (m, n).
        relaxation: Its upper bounds over cells.
        region: The box.
        gap: Distance of bound and witness that is near enough.
        threshold: A number of interest: the search ends once the bound is at most, or the witness
            above it.
    """
    search = _Maximization(function, relaxation, region, gap, threshold)
    lower, upper = region.lower[None], region.upper[None]
    root = Cells(lower, upper, relaxation.upper(lower, upper), np.zeros(1, dtype=np.intp))
    bound = greatest_bound(search, root, at_once=SPLIT_AT_ONCE)
    return Maximum(bound, float(search.reached), search.witness, search.leaves[0])


class _Maximization:
    """The search for a greatest value: its witness, and the tree of cells that bounds it.

    Attributes:
        reached: Value at the witness.
        witness: Quantities in the box (n).
        leaves: Place of each cell in the tree of splits, by the cell's label; the root first.
        n_cells: Number of cells.
    """

    def __init__(
        self,
        function: Callable[[Array], Array],
        relaxation: Relaxation,
        region: Box,
        gap: float,
        threshold: float | None,
    ) -> None:
        self._function, self._relaxation, self._region = function, relaxation, region
        self._gap, self._threshold = gap, threshold
        self._generator = np.random.default_rng(0)
        starts = _starts(region, region.counted, self._generator, STARTS)
        starts = np.concatenate([starts, _gate_starts(relaxation, region)])
        self.witness, self.reached = _ascended(function, relaxation, region, starts)
        self.leaves: list[Tree] = [[]]
        self.n_cells = self._climbs_at = 1

    def enough(self, greatest: float) -> float:
        near = self.reached + self._gap
        if self._threshold is None:
            return np.inf if self.n_cells >= MOST_CELLS else near
        refuted = self.reached > self._threshold
        return np.inf if refuted or self.n_cells >= MOST_CELLS else max(self._threshold, near)

    def split(self, cells: Cells) -> tuple[Cells, float]:
        """Halves each cell where that lowers its bound most, and climbs from points in one."""
        relaxation, counted = self._relaxation, self._region.counted
        if self.n_cells >= self._climbs_at:
            self._climb(Box(cells.lower[0], cells.upper[0]))
        if not relaxation.shared:
            return cells[np.zeros(len(cells), dtype=bool)], float(cells.bound.max())
        halves = [_halves(cells, index, index in counted) for index in relaxation.shared]
        ends = [((cells.lower, below), (above, cells.upper)) for below, above, _ in halves]
        lower, upper = (
            np.concatenate([half[end] for both in ends for half in both]) for end in (0, 1)
        )
        # What each quantity's two halves of each cell are bounded by (k, 2, m).
        bounds = relaxation.upper(lower, upper).reshape(len(halves), 2, len(cells))
        lowered = cells.bound - bounds
        width = (cells.upper - cells.lower)[:, relaxation.shared].T
        gains = lowered.min(axis=1) + 0.3 * lowered.max(axis=1) + 1e-9 * width
        gains = np.where([splits for _, _, splits in halves], gains, -np.inf)
        place, row = np.argmax(gains, axis=0), np.arange(len(cells))
        splits = np.max(gains, axis=0) > -np.inf
        stuck = cells.bound[~splits].max(initial=-np.inf)
        place, row = place[splits], row[splits]
        below = np.array([own for own, _, _ in halves])[place, row]
        above = np.array([own for _, own, _ in halves])[place, row]
        index = np.array(relaxation.shared)[place]
        cuts = 0.5 * (below + above)[np.arange(len(row)), index]
        labels = [
            self._cut(label, int(i), float(cut))
            for label, i, cut in zip(cells.label[row], index, cuts, strict=True)
        ]
        parts = Cells(
            np.stack([cells.lower[row], above], axis=1).reshape(-1, cells.lower.shape[1]),
            np.stack([below, cells.upper[row]], axis=1).reshape(-1, cells.lower.shape[1]),
            bounds[place, :, row].ravel(),
            np.array(labels, dtype=np.intp).ravel(),
        )
        self.n_cells += len(row)
        return parts, float(stuck)

    def _climb(self, cell: Box) -> None:
        """Seeks a better witness from points in a cell; the rarer, the more cells there are."""
        self._climbs_at = 2 * self.n_cells
        starts = _starts(cell, self._region.counted, self._generator, STARTS // 4)
        witness, value = _ascended(self._function, self._relaxation, self._region, starts)
        if value > self.reached:
            self.witness, self.reached = witness, value

    def _cut(self, label: int, index: int, cut: float) -> tuple[int, int]:
        """Splits a cell in the tree, and returns the labels of its parts."""
        below, above = [], []
        self.leaves[label][:] = [index, cut, below, above]
        self.leaves += [below, above]
        return len(self.leaves) - 2, len(self.leaves) - 1


def _halves(cells: Cells, index: int, counted: bool) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Returns upper corners of lower halves, lower corners of upper ones, and which can be."""
    low, high = cells.lower[:, index], cells.upper[:, index]
    middle = 0.5 * (low + high)
    below, above = cells.upper.copy(), cells.lower.copy()
    below[:, index] = np.floor(middle) if counted else middle
    above[:, index] = np.floor(middle) + 1.0 if counted else middle
    splits = high - low >= 1.0 if counted else (middle > low) & (middle < high)
    return below, above, splits


def _starts(of: Box, counted: Collection[int], generator: np.random.Generator, count: int) -> Array:
    ends = generator.integers(0, 3, (count, len(of.lower))) / 2.0
    points = of.lower + ends * (of.upper - of.lower)
    points[0] = 0.5 * (of.lower + of.upper)
    return _whole(points, counted)


def _whole(points: Array, counted: Collection[int]) -> Array:
    points[:, list(counted)] = np.floor(points[:, list(counted)])
    return points


def _gate_starts(relaxation: Relaxation, region: Box) -> Array:
    """Returns points with the gates at their ends, in all ways; between them all is affine."""
    gates = relaxation.gates[:MOST_GATES]
    ways = np.array(list(product((0.0, 1.0), repeat=len(gates)))).reshape(2 ** len(gates), -1)
    points = np.tile(0.5 * (region.lower + region.upper), (len(ways), 1))
    points = _whole(points, region.counted)
    points[:, gates] = region.lower[gates] + ways * (region.upper - region.lower)[gates]
    return points


def _ascended(
    function: Callable[[Array], Array], relaxation: Relaxation, region: Box, points: Array
) -> tuple[Array, float]:
    """Climbs from points, a quantity at a time, and returns where it is highest, and how high."""
    points = np.clip(points, region.lower, region.upper)
    values = function(points)
    rest = [index for index in relaxation.used if index not in relaxation.gates]
    for sweep in range(SWEEPS):
        before = values.copy()
        # With the gates where they start, the first sweep finds the best of all others.
        for index in rest if sweep == 0 else relaxation.used:
            tried = _values_of(index, relaxation, region)
            moved = np.repeat(points[:, None], len(tried), axis=1)
            moved[:, :, index] = tried
            found = function(moved.reshape(-1, moved.shape[-1])).reshape(len(points), -1)
            found = np.where(np.isnan(found), -np.inf, found)
            best = np.argmax(found, axis=1)
            better = found[np.arange(len(points)), best] > values
            points = np.where(better[:, None], moved[np.arange(len(points)), best], points)
            values = np.where(better, found[np.arange(len(points)), best], values)
        if sweep and np.all(values <= before + 1e-12):
            break
        highest = np.argsort(-values, kind="stable")[:STARTS]
        points, values = points[highest], values[highest]
    best = int(np.argmax(values))
    return points[best], float(values[best])


def _values_of(index: int, relaxation: Relaxation, region: Box) -> Array:
    low, high = region.lower[index], region.upper[index]
    if index in region.counted:
        return np.arange(low, high + 1.0)
    return np.linspace(low, high, INNER_POINTS if index in relaxation.curved else 2)
