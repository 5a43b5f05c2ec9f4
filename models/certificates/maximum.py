"""The greatest value of a polynomial of observed quantities over a box, and a witness of it."""

from collections.abc import Callable, Collection, Sequence
from fractions import Fraction
from functools import cache, cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.branch_and_bound import Cells, greatest_bound
from glassgait.models.certificates.question import Box, Maximum, Tree
from glassgait.models.formulas.interval import FUNCTIONS, Interval
from glassgait.models.formulas.polynomial import Monomial, Polynomial, PolynomialRing

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

Element = tuple[int, int]
"""A factor and its power: what a relaxation takes for a variable of its own."""

MOST_AT_CORNERS = 10
"""Elements whose ends are combined in all ways; others that meet are bounded by their product."""

BLOCK = 200_000
"""Numbers of an array that is worked on at once."""

ROUNDING = 2.0**-52


class Relaxation:
    """Bounds a polynomial over boxes of quantities from above.

    Where powers of factors are taken for independent of one another, the polynomial is affine in
    each, so that its maximum is where some elements are at their ends: the gates, which meet other
    elements in products. Of the others, with the gates held, it is affine, and its maximum is a
    sum. What is lost is that two elements may depend on the same quantity; boxes that are narrow
    in these `shared` quantities lose little.

    Attributes:
        used: Quantities that the polynomial is of.
        gates: Those of them that its monomials have in common.
        curved: Those of them that it may not be affine in.
        shared: Those that boxes are split by.
    """

    def __init__(self, ring: PolynomialRing, polynomial: Polynomial) -> None:
        self._ring = ring
        self._polynomial = polynomial
        self._elements = sorted({element for monomial in polynomial for element in monomial})
        self._corners = _cover(list(polynomial), self._elements)
        self.used = sorted(
            frozenset().union(*(ring.variables(factor) for factor, _ in self._elements))
        )
        met = [ring.variables(factor) for factor, _ in self._corners]
        self.gates = sorted(frozenset().union(*met))
        self.curved = [index for index in self.used if self._is_curved(index)]
        self.shared = [index for index in self.used if self._is_shared(index)]

    def upper(self, lower: Array, upper: Array) -> Array:
        """Bounds the polynomial from above over boxes.

        Args:
            lower: Least quantities of each box (m, n).
            upper: Greatest quantities of each box (m, n).

        Returns:
            Bounds (m,), rounded up; infinite where there is none.
        """
        size = max(1, BLOCK >> len(self._corners))
        blocks = [slice(start, start + size) for start in range(0, len(lower), size)]
        return np.concatenate([self._upper(lower[own], upper[own]) for own in blocks])

    def _upper(self, lower: Array, upper: Array) -> Array:
        ranges = self._ranges(lower, upper)
        m = len(lower)
        # An element at a corner (V, 1) × its two ends (V, m).
        at_corner = {
            element: np.where(
                self._ends[:, place, None] > 0, ranges[element].upper, ranges[element].lower
            )
            for place, element in enumerate(self._corners)
        }
        whole = np.zeros((len(self._ends), m))
        with np.errstate(invalid="ignore"):
            for rest, terms in self._by_rest.items():
                coefficient = np.zeros_like(whole)
                for held, number in terms:
                    part = np.full_like(whole, number)
                    for element in held:
                        part *= at_corner[element]
                    coefficient += part
                span = _product_of([ranges[element] for element in rest], m)
                whole += np.maximum(coefficient * span.lower, coefficient * span.upper)
        found = whole.max(axis=0) + self._rounding(ranges, m)
        return np.where(np.isnan(found), np.inf, found)

    @cached_property
    def _ends(self) -> Array:
        """All corners of the elements that meet others (V, k)."""
        corners = list(product((0, 1), repeat=len(self._corners)))
        return np.array(corners).reshape(len(corners), len(self._corners))

    @cached_property
    def _by_rest(self) -> dict[Monomial, list[tuple[list[Element], float]]]:
        """Groups monomials by their elements that are at no corner."""
        groups: dict[Monomial, list[tuple[list[Element], float]]] = {}
        for monomial, coefficient in self._polynomial.items():
            rest = tuple(element for element in monomial if element not in self._corners)
            held = [element for element in monomial if element in self._corners]
            groups.setdefault(rest, []).append((held, float(coefficient)))
        return groups

    def _rounding(self, ranges: dict[Element, Interval], m: int) -> Array:
        """Bounds what rounding can do: each of k operations is off by a share of 2^-53."""
        operations = 8 + len(self._polynomial) + 2 * max(map(len, self._polynomial), default=0)
        size = np.zeros(m)
        for monomial, coefficient in self._polynomial.items():
            part = np.full(m, abs(float(coefficient)))
            for element in monomial:
                part *= ranges[element].magnitude
            size += part
        return operations * ROUNDING * size

    def _ranges(self, lower: Array, upper: Array) -> dict[Element, Interval]:
        @cache
        def of_factor(number: int) -> Interval:
            factor = self._ring.factors[number]
            if factor.function == "variable":
                return Interval(lower[:, factor.variable], upper[:, factor.variable])
            return FUNCTIONS[factor.function](of_polynomial(factor.argument))

        def of_polynomial(terms: Sequence[tuple[Monomial, Fraction]]) -> Interval:
            whole = Interval.point(0.0, (len(lower),))
            for monomial, coefficient in terms:
                near = float(coefficient)
                part = Interval(*(np.full(len(lower), end) for end in _around(near)))
                for factor, power in monomial:
                    part = part * of_factor(factor).power(power)
                whole = whole + part
            return whole

        return {(factor, power): of_factor(factor).power(power) for factor, power in self._elements}

    def _is_shared(self, index: int) -> bool:
        own = self._elements_of(index)
        return len(own) > 1 or any(self._is_loose(number) for number, _ in own)

    def _is_curved(self, index: int) -> bool:
        return any(
            power > 1 or self._ring.factors[number].function != "variable"
            for number, power in self._elements_of(index)
        )

    def _elements_of(self, index: int) -> list[Element]:
        return [own for own in self._elements if index in self._ring.variables(own[0])]

    def _is_loose(self, number: int) -> bool:
        """Returns whether a function's bounds may be wider than its values."""
        argument = self._ring.factors[number].argument
        inner = [factor for monomial, _ in argument for factor, _ in monomial]
        return (
            len(inner) != len(set(inner))
            or any(sum(power for _, power in monomial) > 1 for monomial, _ in argument)
            or any(self._ring.factors[factor].function != "variable" for factor in inner)
        )


def _cover(monomials: Sequence[Monomial], elements: Sequence[Element]) -> list[Element]:
    """Chooses elements such that every monomial has at most one that is not chosen."""
    chosen: list[Element] = []
    while len(chosen) < MOST_AT_CORNERS:
        rest = [[e for e in monomial if e not in chosen] for monomial in monomials]
        meeting = [own for own in rest if len(own) > 1]
        if not meeting:
            break
        counts = {element: sum(element in own for own in meeting) for element in elements}
        chosen.append(max(elements, key=lambda element: counts[element]))
    return chosen


def _product_of(spans: Sequence[Interval], m: int) -> Interval:
    whole = Interval.point(1.0, (m,))
    for span in spans:
        whole = span if whole.lower[0] == whole.upper[0] == 1.0 and m else whole * span
    return whole


def _around(value: float) -> tuple[float, float]:
    return float(np.nextafter(value, -np.inf)), float(np.nextafter(value, np.inf))


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
    return Maximum(bound, float(search.reached), search.witness, search.leaves[0], search.n_cells)


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
        self.n_cells = 1

    def enough(self, greatest: float) -> float:
        near = self.reached + self._gap
        if self._threshold is None:
            return np.inf if self.n_cells >= MOST_CELLS else near
        refuted = self.reached > self._threshold
        return np.inf if refuted or self.n_cells >= MOST_CELLS else max(self._threshold, near)

    def split(self, cells: Cells) -> tuple[Cells, float]:
        """Halves each cell where that lowers its bound most, and climbs from points in one."""
        relaxation, counted = self._relaxation, self._region.counted
        best = Box(cells.lower[0], cells.upper[0])
        starts = _starts(best, counted, self._generator, STARTS // 4)
        witness, value = _ascended(self._function, relaxation, self._region, starts)
        if value > self.reached:
            self.witness, self.reached = witness, value
        if not relaxation.shared:
            return cells[np.zeros(len(cells), dtype=bool)], float(cells.bound.max())
        halves = [_halves(cells, index, index in counted) for index in relaxation.shared]
        bounds, gains = [], []
        for index, (below, above, splits) in zip(relaxation.shared, halves, strict=True):
            ends = ((cells.lower, below), (above, cells.upper))
            bounds.append(np.stack([relaxation.upper(*own) for own in ends]))
            lowered = cells.bound - bounds[-1]
            width = (cells.upper - cells.lower)[:, index]
            gain = lowered.min(0) + 0.3 * lowered.max(0) + 1e-9 * width
            gains.append(np.where(splits, gain, -np.inf))
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
            np.array(bounds)[place, :, row].ravel(),
            np.array(labels, dtype=np.intp).ravel(),
        )
        self.n_cells += len(row)
        return parts, float(stuck)

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
    best = int(np.argmax(values))
    return points[best], float(values[best])


def _values_of(index: int, relaxation: Relaxation, region: Box) -> Array:
    low, high = region.lower[index], region.upper[index]
    if index in region.counted:
        return np.arange(low, high + 1.0)
    return np.linspace(low, high, INNER_POINTS if index in relaxation.curved else 2)
