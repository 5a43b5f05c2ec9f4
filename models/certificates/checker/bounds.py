"""Bounds of targets in balls of real numbers, and of what double precision adds to them.

Targets are multiplied out to polynomials of quantities and of functions, with exact fractions. A
polynomial is affine in each power of these, so over a box it is greatest where each is at one of
its ends. A term adds a table over the ends of its factors; tables are added up, and maximised over
one factor after the other.

The error of double precision is the running error of Higham, Accuracy and Stability of Numerical
Algorithms, section 3.3, of each node over the whole box.
"""

import math
from collections.abc import Collection
from copy import copy
from dataclasses import dataclass
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from .files import RefusedError, refuse_unless
from .robot import Box, Robot

ctx.prec = 96

MOST_FUNCTIONS, MOST_TERMS, MOST_FACTORS, MOST_BITS = 100, 20_000, 100, 20_000
MOST_TOGETHER = 10
"""Factors that may meet in a table; where more do, tables are maximised apart: a bound still."""

UNIT = arb(2) ** -53
"""Error of one operation, as a share of its result."""

LIBRARY = 16
"""The same of a function, in units: NumPy's and C libraries' are within 4 of the last place."""

SMALLEST, GREATEST = arb(2) ** -1000, arb(10) ** 300
LARGEST_ERROR = arb("1e-9")
"""Error of a target (rad) beyond which nothing is certified."""

GREATER = np.frompyfunc(arb.max, 2, 1)

Span = tuple[arb, arb]
"""Least and greatest value, each a ball about one number."""

Factor = tuple[str, int]
"""A variable and its power."""

Terms = list[tuple[arb, list[Factor]]]


def hull(values: list[arb]) -> Span:
    """Returns the least and the greatest of numbers."""
    return reduce(arb.min, values), reduce(arb.max, values)


def multiplied(first: Span, last: Span) -> Span:
    """Returns the least and the greatest product of numbers of two intervals."""
    return hull([a * b for a in first for b in last])


def image(function: str, low: arb, high: arb) -> Span:
    """Returns the values of a function over an interval."""
    if function == "inverse":
        refuse_unless(low > 0 or high < 0, "a formula divides by what may be 0")
        return 1 / high, 1 / low
    ends = [getattr(end, function)() for end in (low, high)]
    if function in ("sin", "cos"):
        # Crests and troughs are where this is whole, and turn about.
        half = fmpq(function == "sin", 2)
        first, last = ((end / arb.pi() - half).floor().unique_fmpz() for end in (low, high))
        if first is None or last is None:
            raise RefusedError("it is not sure where a wave turns")
        ends += [arb((-1) ** (turn % 2)) for turn in range(int(first) + 1, int(last) + 1)[:2]]
    return hull(ends)


@dataclass(frozen=True)
class Ranged:
    """Least and greatest exact value of a formula over a box, and greatest error."""

    low: arb
    high: arb
    error: arb

    @property
    def size(self) -> arb:
        return abs(self.low).max(abs(self.high))

    def __neg__(self) -> "Ranged":
        return Ranged(-self.high, -self.low, self.error)

    def __add__(self, other: "Ranged") -> "Ranged":
        return rounded(self.low + other.low, self.high + other.high, self.error + other.error)

    def __sub__(self, other: "Ranged") -> "Ranged":
        return self + -other


def rounded(low: arb, high: arb, error: arb, units: int = 2) -> Ranged:
    """Adds the rounding of one operation, and keeps the ball's upper end."""
    size = Ranged(low, high, error).size
    error = arb((error + units * UNIT * (size + error) + SMALLEST).upper())
    refuse_unless(size + error < GREATEST, "a formula may overflow")
    return Ranged(low, high, error)


class Rounding:
    """Arithmetic of a robot's formulas in double precision, over one box of what they read."""

    def __init__(self, robot: Robot, box: Box) -> None:
        self.robot, self.box, self.known = robot, box, dict[Any, Ranged]()

    def number(self, value: float) -> Ranged:
        return Ranged(arb(value), arb(value), arb(0))

    def quantity(self, name: str) -> Ranged:
        """Returns a quantity, which is computed from a scaled and shifted observation."""
        low, high = map(arb, self.box[name])
        size = abs(low).max(abs(high))
        return Ranged(low, high, 4 * UNIT * (size + abs(arb(self.robot.offset(name)))))

    def product(self, a: Ranged, b: Ranged) -> Ranged:
        error = a.size * b.error + b.size * a.error + a.error * b.error
        low, high = multiplied((a.low, a.high), (b.low, b.high))
        return rounded(low.max(arb(0)) if a is b else low, high, error)

    def quotient(self, a: Ranged, b: Ranged) -> Ranged:
        away = b.low.max(-b.high)
        refuse_unless(away > b.error, "a formula divides by what may be 0")
        low, high = multiplied((a.low, a.high), image("inverse", b.low, b.high))
        return rounded(low, high, (a.error + abs(low).max(abs(high)) * b.error) / (away - b.error))

    def function(self, name: str, a: Ranged) -> Ranged:
        # None of the functions has a slope above 1.
        return rounded(*image(name, a.low, a.high), a.error, LIBRARY)

    def target(self, found: Ranged, joint: str) -> arb:
        """Returns the error of a target (rad), which a policy returns as an action."""
        stance = abs(arb(self.robot.stance[joint]))
        error = arb((found.error + 4 * UNIT * (found.size + found.error + stance)).upper())
        accepted = error <= LARGEST_ERROR
        refuse_unless(accepted, f"a target of {joint} may be off by too much in double precision")
        return error


class Polynomials:
    """Exact arithmetic of quantities and of functions, each function a variable of its own."""

    def __init__(self, quantities: list[str]) -> None:
        self.names = [*quantities, "other", *(f"f{i}" for i in range(MOST_FUNCTIONS))]
        self.ring = fmpq_mpoly_ctx.get(self.names)
        self.variables = dict(zip(self.names, self.ring.gens(), strict=True))
        self.inner: dict[str, Function] = {}
        self.known: dict[Any, fmpq_mpoly] = {}
        self.replaced = ""

    def number(self, value: float) -> fmpq_mpoly:
        return self.ring.constant(fmpq(*value.as_integer_ratio()))

    def quantity(self, name: str) -> fmpq_mpoly:
        return self.variables["other" if name == self.replaced else name]

    def product(self, a: fmpq_mpoly, b: fmpq_mpoly) -> fmpq_mpoly:
        refuse_unless(len(a) * len(b) <= MOST_TERMS, "a formula has too many terms")
        whole = a * b
        few = not whole or whole.total_degree() <= MOST_FACTORS
        # A number that is raised to powers of powers would fill the memory.
        few &= len(whole) != 1 or whole.coefficient(0).height_bits() <= MOST_BITS
        refuse_unless(few, "a formula multiplies too often")
        return whole

    def quotient(self, a: fmpq_mpoly, b: fmpq_mpoly) -> fmpq_mpoly:
        return self.product(a, self.function("inverse", b))

    def function(self, name: str, inner: fmpq_mpoly) -> fmpq_mpoly:
        """Returns the variable that stands for a function of a polynomial."""
        for variable, known in self.inner.items():
            if (known.name, known.inner) == (name, inner):
                return self.variables[variable]
        variable = f"f{len(self.inner)}"
        refuse_unless(variable in self.variables, "a policy has too many functions to check")
        terms = self.terms(inner)
        of = set[int]().union(*(self.of(own) for _, term in terms for own, _ in term))
        self.inner[variable] = Function(name, inner, terms, of)
        return self.variables[variable]

    def replacing(self, name: str) -> "Polynomials":
        """Returns the same arithmetic where a quantity has another value."""
        other = copy(self)
        other.known, other.replaced = {}, name
        return other

    def slope(self, formula: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """Differentiates by a quantity."""
        whole = formula.derivative(name)
        for own in ({*self.names} - {*formula.unused_gens()}) & self.inner.keys():
            function, inner, *_ = self.inner[own]
            value = self.variables[own]
            if along := self.slope(inner, name):
                derivatives = {
                    "tanh": lambda value, _: 1 - value**2,
                    "sin": lambda _, inner: self.function("cos", inner),
                    "cos": lambda _, inner: -self.function("sin", inner),
                    "inverse": lambda value, _: -(value**2),
                }
                whole += formula.derivative(own) * derivatives[function](value, inner) * along
        return whole

    def terms(self, formula: fmpq_mpoly) -> Terms:
        """Lists coefficients with the factors of each."""
        return [
            (arb(number), [(self.names[i], power) for i, power in enumerate(powers) if power])
            for powers, number in formula.to_dict().items()
        ]

    def of(self, name: str) -> set[int]:
        """Returns by number the quantities that a variable depends on."""
        return self.inner[name].of if name in self.inner else {self.names.index(name)}

    def order(self, factor: Factor) -> tuple[list[int], str, int, str]:
        """Orders factors as the prover does."""
        name, power = factor
        function = self.inner[name].name if name in self.inner else "variable"
        return sorted(self.of(name)), function, power, name

    def greatest(
        self, formula: fmpq_mpoly, box: Box, splits: list, counted: Collection[str]
    ) -> arb:
        """Bounds a polynomial from above over a box, cell by cell of a tree of splits."""
        terms = self.terms(formula)
        factors = sorted({factor for _, term in terms for factor in term}, key=self.order)
        plan = Elimination(terms, factors)

        def over(cell: Box, splits: list) -> arb:
            if not splits:
                spans: dict[str, Span] = {}
                return plan.greatest([self.power_span(own, cell, spans) for own in factors])
            name, cut, below, above = splits
            low, high = cell[name]
            refuse_unless(low <= cut <= high, f"a split of {name} is outside of its cell")
            ends = (math.floor(cut), math.floor(cut) + 1) if name in counted else (cut, cut)
            first = over({**cell, name: (low, ends[0])}, below)
            return first.max(over({**cell, name: (ends[1], high)}, above))

        return over(box, splits)

    def power_span(self, factor: Factor, cell: Box, spans: dict[str, Span]) -> Span:
        """Bounds a power of a variable over a cell; `spans` keeps the variables' bounds."""
        name, power = factor
        if name in self.inner and name not in spans:
            own, low, high = self.inner[name], arb(0), arb(0)
            for number, term in own.terms:
                part = number, number
                for own_factor in term:
                    part = multiplied(part, self.power_span(own_factor, cell, spans))
                low, high = low + part[0], high + part[1]
            spans[name] = image(own.name, low, high)
        elif name not in spans:
            spans[name] = arb(cell[name][0]), arb(cell[name][1])

        # An even power has its least value at 0.
        low, high = spans[name]
        holds_zero = not (low > 0 or high < 0)
        ends = [low**power, high**power]
        return hull([*ends, arb(0)] if power % 2 == 0 and holds_zero else ends)


class Function(NamedTuple):
    """A function of a polynomial, the polynomial's terms and the quantities that it is of."""

    name: str
    inner: fmpq_mpoly
    terms: Terms
    of: set[int]


class Elimination:
    """Tables of terms, and the order in which they are added up and maximised."""

    def __init__(self, terms: Terms, factors: list[Factor]) -> None:
        number = {factor: index for index, factor in enumerate(factors)}
        self.terms = [(value, sorted(number[own] for own in term)) for value, term in terms]
        self.scopes = [scope for _, scope in self.terms]
        self.steps: list[tuple[int, list[int], list[int]]] = []
        left, open_tables = list(number.values()), dict(enumerate(self.scopes))
        while left:
            # Maximise next over the factor that meets fewest others, the first of equals.
            met: dict[int, set[int]] = {factor: set() for factor in left}
            for scope in open_tables.values():
                for own in scope:
                    met[own].update(scope)
            factor = min(left, key=lambda own: len(met[own]))
            left.remove(factor)
            for bucket, together in self.buckets(factor, open_tables):
                scope = sorted(together)
                self.steps.append((factor, bucket, scope))
                for i in bucket:
                    del open_tables[i]
                open_tables[len(self.scopes)] = [own for own in scope if own != factor]
                self.scopes.append(open_tables[len(self.scopes)])

    def buckets(
        self, factor: int, tables: dict[int, list[int]]
    ) -> list[tuple[list[int], set[int]]]:
        """Groups a factor's tables, so that not too many factors meet in one."""
        groups: list[tuple[list[int], set[int]]] = []
        holding = [i for i, scope in tables.items() if factor in scope]
        for i in sorted(holding, key=lambda i: (-len(tables[i]), i)):
            room = (group for group in groups if len(group[1].union(tables[i])) <= MOST_TOGETHER)
            bucket, together = next(room, ([], {factor}))
            if not bucket:
                groups.append((bucket, together))
            bucket.append(i)
            together.update(tables[i])
        return groups

    def greatest(self, ends: list[Span]) -> arb:
        """Bounds the polynomial from above, given the ends of each factor."""
        # The table of a term has an axis of two ends for each factor of its scope.
        tables: list[Any] = []
        for value, scope in self.terms:
            tables.append(np.array(value, dtype=object))
            for factor in scope:
                tables[-1] = np.multiply.outer(tables[-1], np.array(ends[factor], dtype=object))

        # Add tables up, and keep the greater end of the factor.
        for factor, numbers, scope in self.steps:
            whole = np.array(arb(0), dtype=object)
            for i in numbers:
                axes = tuple(slice(None) if own in self.scopes[i] else None for own in scope)
                whole = whole + np.asarray(tables[i])[axes]
            tables.append(GREATER(*np.moveaxis(whole, scope.index(factor), 0)))
        done = (table for table, scope in zip(tables, self.scopes, strict=True) if not scope)
        return sum((np.asarray(table).item() for table in done), arb(0))
