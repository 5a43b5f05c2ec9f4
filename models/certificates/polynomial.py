"""Formulas as polynomials of quantities and of functions, and their upper bounds over boxes.

A formula such as `late*(0.1 - 0.2*cmd.yaw) + lifted.FL*q.FL_hip` is multiplied out to monomials,
each a number times powers of *factors*: quantities, and functions such as tanh(0.5*t - 2) of other
polynomials. Coefficients are fractions: nothing is rounded, and terms that cancel are gone.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cache
from typing import NamedTuple

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.interval import FUNCTIONS, Interval

MOST_MONOMIALS = 20_000

Monomial = tuple[tuple[int, int], ...]
"""Factors by number, in order, each with its power."""

Polynomial = Mapping[Monomial, Fraction]

_POWERS = {"square": 2, "cube": 3}


@dataclass(frozen=True)
class Factor:
    """A quantity by index, whose function is "variable", or a function of a polynomial."""

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
        """Multiplies a formula of observed quantities out."""
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
            case operator, [inner] if operator in _POWERS:
                whole = inner
                for _ in range(_POWERS[operator] - 1):
                    whole = product(whole, inner)
                return whole
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
    whole: dict[Monomial, Fraction] = {}
    for polynomial in polynomials:
        for monomial, coefficient in polynomial.items():
            whole[monomial] = whole.get(monomial, Fraction(0)) + factor * coefficient
    return {monomial: coefficient for monomial, coefficient in whole.items() if coefficient}


def product(left: Polynomial, right: Polynomial) -> Polynomial:
    """Multiplies two polynomials."""
    if len(left) * len(right) > MOST_MONOMIALS:
        raise InputError(
            f"a formula has more than {MOST_MONOMIALS} terms when it is multiplied out; write a "
            "simpler one"
        )
    whole: dict[Monomial, Fraction] = {}
    for one, a in left.items():
        for other, b in right.items():
            powers = dict(one)
            for factor, power in other:
                powers[factor] = powers.get(factor, 0) + power
            monomial = tuple(sorted(powers.items()))
            whole[monomial] = whole.get(monomial, Fraction(0)) + a * b
    return {monomial: coefficient for monomial, coefficient in whole.items() if coefficient}


Element = tuple[int, int]
"""A factor and its power: what a relaxation takes for a variable of its own."""

MOST_TOGETHER, BLOCK, ROUNDING = 10, 200_000, 2.0**-52
"""Elements whose ends are combined in all ways, numbers of an array that is worked on at once, and
the error of an operation."""

Scope = tuple[Element, ...]
"""The elements that a table has an axis of, in order."""


class Step(NamedTuple):
    """Adds up tables by number, maximises over one element, and numbers the rest next."""

    element: Element
    tables: tuple[int, ...]
    scope: Scope


class Relaxation:
    """Bounds a polynomial over boxes of quantities from above.

    If powers of factors, its *elements*, were independent, the polynomial would be affine in each,
    and greatest at ends of all. Monomials are tables over these ends, which are added up and
    maximised over one element after the other (variable elimination, Bertelè and Brioschi,
    Nonserial Dynamic Programming, 1972); where more than `MOST_TOGETHER` elements meet, apart
    (mini-buckets, Dechter and Rish 2003). Boxes that are narrow in `shared` quantities lose little.

    Attributes:
        used: Quantities that the polynomial is of.
        curved: Those of them that it may not be affine in.
        shared: Those that boxes are split by.
    """

    def __init__(self, ring: PolynomialRing, polynomial: Polynomial) -> None:
        self._ring = ring
        # An order that another program finds as well, whatever it calls the factors.
        self._elements = sorted(
            {element for monomial in polynomial for element in monomial}, key=self._key
        )
        place = {element: index for index, element in enumerate(self._elements)}
        self._monomials: dict[Scope, float] = {
            tuple(sorted(monomial, key=place.__getitem__)): float(coefficient)
            for monomial, coefficient in polynomial.items()
        }
        self._steps = eliminated(list(self._monomials), self._elements)
        of_elements = (ring.variables[number] for number, _ in self._elements)
        self.used = sorted(frozenset[int]().union(*of_elements))
        self.curved, self.shared = list[int](), list[int]()
        for index in self.used:
            of = [own for own in self._elements if index in ring.variables[own[0]]]
            if any(power > 1 or ring.factors[i].function != "variable" for i, power in of):
                self.curved.append(index)
            if len(of) > 1 or any(self._is_loose(number) for number, _ in of):
                self.shared.append(index)

    def upper(self, lower: Array, upper: Array) -> Array:
        """Bounds the polynomial (m,) from above over boxes from `lower` to `upper` (m, n).

        Bounds are rounded up, and infinite where there is none.
        """
        together = max((len(step.scope) for step in self._steps), default=0)
        size = max(1, BLOCK >> together)
        blocks = (slice(i, i + size) for i in range(0, len(lower), size))
        return np.concatenate([self._upper(lower[own], upper[own]) for own in blocks])

    def _upper(self, lower: Array, upper: Array) -> Array:
        ranges, m = self._ranges(lower, upper), len(lower)
        # Add tables up, and maximise them; what has no value becomes NaN.
        with np.errstate(invalid="ignore", over="ignore"):
            ends = {own: np.stack([span.lower, span.upper]) for own, span in ranges.items()}
            tables = [_product(scope, c, ends, m) for scope, c in self._monomials.items()]
            scopes = list(self._monomials)
            for step in self._steps:
                whole = sum(_spread(tables[i], scopes[i], step.scope) for i in step.tables)
                axis = step.scope.index(step.element)
                tables.append(np.max(whole, axis=axis))
                scopes.append(step.scope[:axis] + step.scope[axis + 1 :])
            done = [table for table, scope in zip(tables, scopes, strict=True) if not scope]
            found = sum(done, np.zeros(m)) + self._rounding(ranges, m)
        return np.where(np.isnan(found), np.inf, found)

    def _rounding(self, ranges: dict[Element, Interval], m: int) -> Array:
        """Bounds what rounding can do: each of k operations is off by a share of 2^-53."""
        operations = 8 + len(self._monomials) + 2 * max(map(len, self._monomials), default=0)
        sizes = (
            math.prod([ranges[element].magnitude for element in monomial], start=abs(coefficient))
            for monomial, coefficient in self._monomials.items()
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
            whole = Interval.point(0.0, (len(lower),))
            for monomial, coefficient in terms:
                ends = np.nextafter(float(coefficient), [-np.inf, np.inf])
                part = Interval(*(np.full(len(lower), end) for end in ends))
                for factor, power in monomial:
                    part = part * of_factor(factor).power(power)
                whole = whole + part
            return whole

        return {(factor, power): of_factor(factor).power(power) for factor, power in self._elements}

    def _key(self, element: Element) -> tuple[list[int], str, int, Element]:
        number, power = element
        function = self._ring.factors[number].function
        return sorted(self._ring.variables[number]), function, power, element

    def _is_loose(self, number: int) -> bool:
        """Returns whether a function's bounds may be wider than its values."""
        argument = self._ring.factors[number].argument
        inner = [factor for monomial, _ in argument for factor, _ in monomial]
        return (
            len(inner) != len(set(inner))
            or any(sum(power for _, power in monomial) > 1 for monomial, _ in argument)
            or any(self._ring.factors[factor].function != "variable" for factor in inner)
        )


def eliminated(scopes: Sequence[Scope], elements: Sequence[Element]) -> list[Step]:
    """Plans the elimination of tables with these scopes: first where fewest elements meet."""
    tables, steps, of = list(scopes), [], {}
    for element in elements:
        of[element] = {i for i, scope in enumerate(scopes) if element in scope}
    meeting = {element: _joined(tables[i] for i in of[element]) for element in elements}
    while of:
        element = min(of, key=lambda own: len(meeting[own]))
        for bucket in _buckets(element, of.pop(element), tables):
            # What a step leaves is a table of the other elements.
            together = _joined(tables[i] for i in bucket)
            scope = tuple(own for own in elements if own in together)
            steps.append(Step(element, bucket, scope))
            tables.append(tuple(own for own in scope if own != element))
            for own in tables[-1]:
                of[own] = of[own] - {*bucket} | {len(tables) - 1}
        for own in meeting[element] - {element}:
            meeting[own] = _joined(tables[i] for i in of[own])
    return steps


def _buckets(
    element: Element, numbers: Collection[int], tables: Sequence[Scope]
) -> list[tuple[int, ...]]:
    """Groups an element's tables such that at most `MOST_TOGETHER` elements meet in each."""
    groups: list[tuple[list[int], set[Element]]] = []
    for number in sorted(numbers, key=lambda i: (-len(tables[i]), i)):
        for group, together in groups:
            if len(together.union(tables[number])) <= MOST_TOGETHER:
                group.append(number)
                together.update(tables[number])
                break
        else:
            groups.append(([number], {element, *tables[number]}))
    return [tuple(group) for group, _ in groups]


def _joined(scopes: Iterable[Scope]) -> frozenset[Element]:
    return frozenset().union(*scopes)


def _product(scope: Scope, coefficient: float, ends: dict[Element, Array], m: int) -> Array:
    """Returns a monomial at the ends of its elements, (2, ..., 2, m)."""
    whole = np.full((1,) * len(scope) + (m,), coefficient)
    for element in scope:
        whole = whole * _spread(ends[element], (element,), scope)
    return whole


def _spread(table: Array, scope: Scope, wider: Scope) -> Array:
    """Gives a table an axis of length 1 for each element that it does not depend on."""
    at = tuple(slice(None) if element in scope else None for element in wider)
    return table[at]
