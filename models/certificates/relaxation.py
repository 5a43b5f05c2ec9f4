"""Upper bounds of a polynomial over boxes, exact where each factor can be chosen by itself."""

from collections.abc import Sequence
from fractions import Fraction
from functools import cache, cached_property
from itertools import product as combinations_of

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.interval import FUNCTIONS, Interval
from glassgait.models.formulas.polynomial import Monomial, Polynomial, PolynomialRing

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
                span = _product([ranges[element] for element in rest], m)
                whole += np.maximum(coefficient * span.lower, coefficient * span.upper)
        found = whole.max(axis=0) + self._rounding(ranges, m)
        return np.where(np.isnan(found), np.inf, found)

    @cached_property
    def _ends(self) -> Array:
        """All corners of the elements that meet others (V, k)."""
        corners = list(combinations_of((0, 1), repeat=len(self._corners)))
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


def _product(spans: Sequence[Interval], m: int) -> Interval:
    whole = Interval.point(1.0, (m,))
    for span in spans:
        whole = span if whole.lower[0] == whole.upper[0] == 1.0 and m else whole * span
    return whole


def _around(value: float) -> tuple[float, float]:
    return float(np.nextafter(value, -np.inf)), float(np.nextafter(value, np.inf))
