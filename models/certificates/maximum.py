"""Branch and bound: the greatest value of a function over a box, from above and by a witness."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.certificates.relaxation import Relaxation

MOST_CELLS = 20_000
"""Cells of a search that gives up: its bound holds, and is less tight."""

SPLIT_AT_ONCE = 64

STARTS = 16
SWEEPS = 6
"""How a witness is sought: from as many starts, quantity by quantity, as often."""

MOST_GATES = 6
"""Quantities whose ends are combined in all ways to start from."""

INNER_POINTS = 9
"""Values of a curved quantity that are tried; of others the ends, where affine functions peak."""

Tree = list
"""A split: [quantity, cut, tree below, tree above]; an empty list where nothing is split."""


@dataclass(frozen=True)
class Box:
    """A box of quantities, in the robot's units.

    Attributes:
        lower: Least quantities (n).
        upper: Greatest quantities (n).
        counted: Quantities that are whole numbers.
    """

    lower: Array
    upper: Array
    counted: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Maximum:
    """What is known of the greatest value of a function over a box.

    Attributes:
        bound: No value is greater.
        reached: Value at the witness.
        witness: Quantities in the box (n).
        splits: The cells that the bound was found over.
        n_cells: Number of these cells.
    """

    bound: float
    reached: float
    witness: Array
    splits: Tree = field(default_factory=list)
    n_cells: int = 1


@dataclass
class _Cells:
    """Cells of a search, one a row, with the place in the tree where each hangs."""

    lower: Array
    upper: Array
    bound: Array
    leaves: list[Tree]

    def kept(self, mask: NDArray[np.bool_]) -> "_Cells":
        leaves = [leaf for leaf, keep in zip(self.leaves, mask, strict=True) if keep]
        return _Cells(self.lower[mask], self.upper[mask], self.bound[mask], leaves)

    def with_others(self, other: "_Cells") -> "_Cells":
        return _Cells(
            np.concatenate([self.lower, other.lower]),
            np.concatenate([self.upper, other.upper]),
            np.concatenate([self.bound, other.bound]),
            self.leaves + other.leaves,
        )


def maximize(
    function: Callable[[Array], Array],
    relaxation: Relaxation,
    region: Box,
    *,
    gap: float,
    threshold: float | None = None,
    seed: int = 0,
) -> Maximum:
    """Bounds the greatest value of a function over a box.

    Args:
        function: Evaluates the function (m,) of quantities (m, n).
        relaxation: Its upper bounds over cells.
        region: The box.
        gap: Distance of bound and witness that is near enough.
        threshold: A number of interest: the search ends once the bound is at most, or the witness
            above it.
        seed: Seed of the starts of the search for a witness.
    """
    generator = np.random.default_rng(seed)
    starts = np.concatenate(
        [_starts(region, region, generator, STARTS), _gate_starts(relaxation, region)]
    )
    witness, reached = _ascended(function, relaxation, region, starts)
    root: Tree = []
    lower, upper = region.lower[None], region.upper[None]
    cells = _Cells(lower, upper, relaxation.upper(lower, upper), [root])
    closed, n_cells = -np.inf, 1
    while True:
        enough = reached + gap if threshold is None else max(threshold, reached + gap)
        done = cells.bound <= enough
        closed = max(closed, cells.bound[done].max(initial=-np.inf))
        cells = cells.kept(~done)
        refuted = threshold is not None and reached > threshold
        if not len(cells.bound) or n_cells >= MOST_CELLS or refuted:
            break
        first = np.zeros(len(cells.bound), dtype=bool)
        first[np.argsort(-cells.bound, kind="stable")[:SPLIT_AT_ONCE]] = True
        parents, cells = cells.kept(first), cells.kept(~first)
        best = Box(parents.lower[0], parents.upper[0], region.counted)
        found, value = _ascended(
            function, relaxation, region, _starts(best, region, generator, STARTS // 4)
        )
        if value > reached:
            witness, reached = found, value
        children, stuck = _split(parents, relaxation, region.counted)
        closed = max(closed, stuck)
        cells = cells.with_others(children)
        n_cells += len(children.bound) // 2
    bound = max(closed, cells.bound.max(initial=-np.inf), reached)
    return Maximum(float(bound), float(reached), witness, root, n_cells)


def _split(
    parents: _Cells, relaxation: Relaxation, counted: Collection[int]
) -> tuple[_Cells, float]:
    """Halves each cell where that lowers its bound most.

    Returns:
        The halves, and the greatest bound of the cells that cannot be split.
    """
    m, n = parents.lower.shape
    tried = [_halves(parents, index, index in counted) for index in relaxation.shared]
    gain = np.full((len(tried), m), -np.inf)
    bounds = []
    for place, (below, above, splits) in enumerate(tried):
        pair = np.stack(
            [
                relaxation.upper(parents.lower, below),
                relaxation.upper(above, parents.upper),
            ]
        )
        bounds.append(pair)
        lowered = parents.bound - pair
        width = (parents.upper - parents.lower)[:, relaxation.shared[place]]
        gain[place] = np.where(
            splits, lowered.min(0) + 0.3 * lowered.max(0) + 1e-9 * width, -np.inf
        )
    stuck = -np.inf
    lower, upper, bound, leaves = [], [], [], []
    for row in range(m):
        place = int(np.argmax(gain[:, row])) if tried else 0
        if not tried or gain[place, row] == -np.inf:
            stuck = max(stuck, float(parents.bound[row]))
            continue
        below, above, _ = tried[place]
        index = relaxation.shared[place]
        children: tuple[Tree, Tree] = ([], [])
        cut = 0.5 * (below[row, index] + above[row, index])
        parents.leaves[row][:] = [index, float(cut), *children]
        lower += [parents.lower[row], above[row]]
        upper += [below[row], parents.upper[row]]
        bound += bounds[place][:, row].tolist()
        leaves += children
    low, high = (np.array(own).reshape(-1, n) for own in (lower, upper))
    return _Cells(low, high, np.array(bound), leaves), stuck


def _halves(cells: _Cells, index: int, counted: bool) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Returns upper corners of lower halves, lower corners of upper ones, and which can be."""
    low, high = cells.lower[:, index], cells.upper[:, index]
    middle = 0.5 * (low + high)
    below, above = cells.upper.copy(), cells.lower.copy()
    below[:, index] = np.floor(middle) if counted else middle
    above[:, index] = np.floor(middle) + 1.0 if counted else middle
    splits = high - low >= 1.0 if counted else (middle > low) & (middle < high)
    return below, above, splits


def _starts(of: Box, region: Box, generator: np.random.Generator, count: int) -> Array:
    ends = generator.integers(0, 3, (count, len(of.lower))) / 2.0
    points = of.lower + ends * (of.upper - of.lower)
    points[0] = 0.5 * (of.lower + of.upper)
    for index in region.counted:
        points[:, index] = np.floor(points[:, index])
    return points


def _gate_starts(relaxation: Relaxation, region: Box) -> Array:
    """Returns points with the gates at their ends, in all ways; between them all is affine."""
    gates = relaxation.gates[:MOST_GATES]
    ways = np.array(list(product((0.0, 1.0), repeat=len(gates)))).reshape(2 ** len(gates), -1)
    points = np.tile(0.5 * (region.lower + region.upper), (len(ways), 1))
    for index in region.counted:
        points[:, index] = np.floor(points[:, index])
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
    best = int(np.argmax(values))
    return points[best], float(values[best])


def _values_of(index: int, relaxation: Relaxation, region: Box) -> Array:
    low, high = region.lower[index], region.upper[index]
    if index in region.counted:
        return np.arange(low, high + 1.0)
    return np.linspace(low, high, INNER_POINTS if index in relaxation.curved else 2)
