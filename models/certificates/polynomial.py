"""Formulas as polynomials of quantities and of functions, and their upper bounds over boxes.

A formula such as `late*(0.1 - 0.2*cmd.yaw) + lifted.FL*q.FL_hip` is multiplied out to monomials,
each a number times powers of *factors*: quantities, and functions such as tanh(0.5*t - 2) of other
polynomials. Coefficients are exact fractions, so terms that cancel vanish.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.interval import FUNCTIONS, Interval

MOST_MONOMIALS = 20_000

Monomial = tuple[tuple[int, int], ...]  # numbers of factors in ascending order, each with its power

Polynomial = Mapping[Monomial, Fraction]


@dataclass(frozen=True)
class Factor:
    """A function of a polynomial; or a quantity, given by its index and the function "variable"."""

    function: str
    variable: int = -1
    argument: tuple[tuple[Monomial, Fraction], ...] = ()


@dataclass
class PolynomialRing:
    """Numbers the factors that polynomials are made of, and lists the quantities of each."""

    factors: list[Factor] = field(default_factory=list)
    variables: list[frozenset[int]] = field(default_factory=list)
    _numbers: dict[Factor, int] = field(default_factory=dict)

    def polynomial(self, formula: Expression) -> Polynomial:
        """Multiplies out a formula of observed quantities."""
        operands = [self.polynomial(operand) for operand in formula.operands]
        match formula.operator, operands:
            case "constant", _:
                return {(): Fraction(formula.value)} if formula.value else {}
            case "variable", _:
                return self._of_factor(Factor("variable", formula.variable))
            case "neg", [inner]:
                return combined(inner, factor=Fraction(-1))
            case "add", [left, right]:
                return combined(left, right)
            case "sub", [left, right]:
                return combined(left, combined(right, factor=Fraction(-1)))
            case "mul", [left, right]:
                return product(left, right)
            case "div", [left, right]:
                return product(left, self._inverse(right))
            case "square", [inner]:
                return product(inner, inner)
            case "cube", [inner]:
                return product(product(inner, inner), inner)
            case operator, [inner]:
                return self._of_factor(Factor(operator, argument=tuple(sorted(inner.items()))))
        raise AssertionError(formula.operator)

    def _inverse(self, divisor: Polynomial) -> Polynomial:
        number = divisor.get((), Fraction(0))
        if set(divisor) == {()} and number:
            return {(): 1 / number}
        return self._of_factor(Factor("inverse", argument=tuple(sorted(divisor.items()))))

    def _of_factor(self, factor: Factor) -> Polynomial:
        if factor not in self._numbers:
            self._numbers[factor] = len(self.factors)
            self.factors.append(factor)
            inner = {number for monomial, _ in factor.argument for number, _ in monomial}
            first = frozenset([factor.variable] if factor.function == "variable" else [])
            self.variables.append(first.union(*(self.variables[number] for number in inner)))
        return {((self._numbers[factor], 1),): Fraction(1)}


def combined(*polynomials: Polynomial, factor: Fraction = Fraction(1)) -> Polynomial:
    """Adds polynomials, and multiplies their sum by a number."""
    result: dict[Monomial, Fraction] = {}
    for polynomial in polynomials:
        for monomial, coefficient in polynomial.items():
            result[monomial] = result.get(monomial, Fraction(0)) + factor * coefficient
    return {monomial: coefficient for monomial, coefficient in result.items() if coefficient}


def product(left: Polynomial, right: Polynomial) -> Polynomial:
    """Multiplies two polynomials."""
    if len(left) * len(right) > MOST_MONOMIALS:
        raise InputError(
            f"a formula has more than {MOST_MONOMIALS} terms when it is multiplied out; simplify it"
        )
    result: dict[Monomial, Fraction] = {}
    for first, a in left.items():
        for second, b in right.items():
            powers = dict(first)
            for factor, power in second:
                powers[factor] = powers.get(factor, 0) + power
            monomial = tuple(sorted(powers.items()))
            result[monomial] = result.get(monomial, Fraction(0)) + a * b
    return {monomial: coefficient for monomial, coefficient in result.items() if coefficient}


Element = tuple[int, int]
"""A factor and its power, which a relaxation treats as an independent variable."""

MOST_BOUNDED, MOST_TRIED, ROUNDING = 2000, 10, 2.0**-52
"""Most monomials, most elements whose two ends are tried, and relative error of an operation."""

Terms = Mapping[frozenset[Element], Array]  # coefficients (m) of products of elements


class Relaxation:
    """Bounds a polynomial over boxes of quantities from above.

    The polynomial is affine in each power of a factor, or *element*. If these are independent, its
    maximum is at a corner of the box. Both ends of one element after the other are tried, and
    groups of monomials without common elements are maximised separately. After `MOST_TRIED`
    elements, monomials are bounded one by one. Bounds are tight for boxes that are narrow in
    `shared` quantities.

    Attributes:
        used: Quantities in the polynomial.
        curved: Quantities in which it may not be affine.
        shared: Quantities by which boxes are split.
    """

    def __init__(self, ring: PolynomialRing, polynomial: Polynomial) -> None:
        self._ring = ring
        if len(polynomial) > MOST_BOUNDED:
            raise InputError(
                f"a formula has more than {MOST_BOUNDED} terms when multiplied out; simplify it"
            )
        self._elements = sorted({element for monomial in polynomial for element in monomial})
        self._terms = {frozenset(monomial): float(polynomial[monomial]) for monomial in polynomial}
        of_elements = (ring.variables[number] for number, _ in self._elements)
        self.used = sorted(frozenset[int]().union(*of_elements))
        self.curved, self.shared = list[int](), list[int]()
        for index in self.used:
            elements = [(i, power) for i, power in self._elements if index in ring.variables[i]]
            if any(power > 1 or ring.factors[i].function != "variable" for i, power in elements):
                self.curved.append(index)
            if len(elements) > 1 or any(self._is_loose(i) for i, _ in elements):
                self.shared.append(index)

    def upper(self, lower: Array, upper: Array) -> Array:
        """Bounds the polynomial (m,) from above over boxes from `lower` to `upper` (m, n).

        Bounds are rounded up, and infinite if the polynomial has no value.
        """
        ranges, m = self._ranges(lower, upper), len(lower)
        # Operations without a value return NaN.
        with np.errstate(invalid="ignore", over="ignore"):
            terms = {term: np.full(m, value) for term, value in self._terms.items()}
            bounds = best(terms, ranges, np.zeros(m), MOST_TRIED) + self._rounding(ranges, m)
        return np.where(np.isnan(bounds), np.inf, bounds)

    def _rounding(self, ranges: dict[Element, Interval], m: int) -> Array:
        """Bounds the rounding error of k operations, each with a relative error of 2^-53."""
        operations = 8 + len(self._terms) + 2 * max(map(len, self._terms), default=0)
        sizes = (
            math.prod([ranges[element].magnitude for element in monomial], start=abs(coefficient))
            for monomial, coefficient in self._terms.items()
        )
        return operations * ROUNDING * np.asarray(sum(sizes, np.zeros(m)))

    def _ranges(self, lower: Array, upper: Array) -> dict[Element, Interval]:
        @cache
        def of_factor(number: int) -> Interval:
            factor = self._ring.factors[number]
            if factor.function == "variable":
                return Interval(lower[:, factor.variable], upper[:, factor.variable])
            return FUNCTIONS[factor.function](of_polynomial(factor.argument))

        def of_polynomial(terms: Sequence[tuple[Monomial, Fraction]]) -> Interval:
            total = Interval.point(0.0, (len(lower),))
            for monomial, coefficient in terms:
                ends = np.nextafter(float(coefficient), [-np.inf, np.inf])
                term = Interval(*(np.full(len(lower), end) for end in ends))
                for factor, power in monomial:
                    term = term * of_factor(factor).power(power)
                total = total + term
            return total

        return {(factor, power): of_factor(factor).power(power) for factor, power in self._elements}

    def _is_loose(self, number: int) -> bool:
        """Returns whether a function's bounds may be wider than its values."""
        argument = self._ring.factors[number].argument
        inner = [factor for monomial, _ in argument for factor, _ in monomial]
        return (
            len(inner) != len(set(inner))
            or any(sum(power for _, power in monomial) > 1 for monomial, _ in argument)
            or any(self._ring.factors[factor].function != "variable" for factor in inner)
        )


def best(terms: Terms, ranges: Mapping[Element, Interval], zeros: Array, n_tries: int) -> Array:
    """Bounds a polynomial from above, (m,) like `zeros`, given the ranges of its elements."""
    bound, rest = terms.get(frozenset(), zeros), {term for term in terms if term}
    while rest:
        # Gather the terms that share elements, directly or through others.
        group, added = set[frozenset[Element]](), {next(iter(rest))}
        while added:
            group, rest = group | added, rest - added
            elements = frozenset().union(*added)
            added = {term for term in rest if term & elements}

        # Try both ends of the most frequent element.
        if n_tries == 0:
            for term in group:
                value = Interval(terms[term], terms[term])
                bound = bound + math.prod((ranges[element] for element in term), start=value).upper
            continue
        counts = Counter(element for term in group for element in term)
        element = max(sorted(counts), key=counts.__getitem__)
        bounds = []
        for end in (ranges[element].lower, ranges[element].upper):
            fixed: dict[frozenset[Element], Array] = {}
            for term in group:
                value = terms[term] * end if element in term else terms[term]
                fixed[term - {element}] = fixed.get(term - {element}, zeros) + value
            bounds.append(best(fixed, ranges, zeros, n_tries - 1))
        bound = bound + np.maximum(*bounds)
    return bound
