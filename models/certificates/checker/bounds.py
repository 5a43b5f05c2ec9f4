"""Bounds formulas, and their errors in double precision, in ball arithmetic.

Formulas are multiplied out to polynomials of quantities and of functions, with exact fractions. A
polynomial is affine in each power of these, its *factors*; if they are independent, its maximum
over a box is at a corner. Both ends of one factor after the other are tried, and groups of terms
without common factors are bounded separately.

The error of double precision is the running error (Higham, Accuracy and Stability of Numerical
Algorithms, section 3.3) of each operation over the whole box.
"""

import math
from collections import Counter
from collections.abc import Callable, Collection
from copy import copy
from functools import cache, reduce
from typing import Any, NamedTuple

from flint import arb, ctx, fmpq, fmpq_mpoly, fmpq_mpoly_ctx

from .files import refuse_unless
from .policy import Box

ctx.prec = 96

MOST_FUNCTIONS, MOST_TERMS, MOST_FACTORS, MOST_BITS = 100, 20_000, 100, 20_000
MOST_BOUNDED, MOST_TRIED = 2000, 10
"""Most terms, and most factors whose two ends are tried; then terms are bounded one by one."""

UNIT, SMALLEST = arb(0, arb(2) ** -53), arb(0, arb(2) ** -1000)
"""Relative error of one operation, and more than the error by underflow."""

LIBRARY = 16
"""Error of a function in units; NumPy and C libraries are within 4 units in the last place."""

GREATEST, STANCE = arb(10) ** 300, 10
"""Greatest accepted result, and more than any angle of a stance, which shifts quantities (rad)."""

Span = tuple[arb, arb]
"""Least and greatest value, each a ball about one number."""

Factor = tuple[str, int]
"""A variable and its power."""

Terms = dict[frozenset[Factor], arb]


class Rounded(NamedTuple):
    """The exact values of a formula over a box, and the error of computed ones."""

    value: arb
    error: arb

    def __neg__(self) -> "Rounded":
        return Rounded(-self.value, self.error)

    def __add__(self, other: Any) -> "Rounded":
        return rounded(self.value + other.value, self.error + other.error)

    def __sub__(self, other: Any) -> "Rounded":
        return self + -other


def rounded(value: arb, error: arb, units: int = 2) -> Rounded:
    """Adds the rounding of one operation."""
    error += units * UNIT * (value + error) + SMALLEST
    finite = abs(value) + abs(error) < GREATEST
    refuse_unless(finite, "a formula may overflow, or divides by what may be 0")
    return Rounded(value, error)


class DoublePrecision:
    """Arithmetic of a robot's formulas over a box; `used` collects their quantities."""

    def __init__(self, box: Box) -> None:
        self.box, self.used = box, set[str]()

    def number(self, value: float) -> Rounded:
        return Rounded(arb(value), arb(0))

    def quantity(self, name: str) -> Rounded:
        """Returns a quantity, which is computed from a scaled and shifted observation."""
        self.used.add(name)
        low, high = map(arb, self.box[name])
        value = low.union(high)
        return Rounded(value, 4 * UNIT * (abs(value) + STANCE))

    def product(self, a: Rounded, b: Rounded) -> Rounded:
        error = a.value * b.error + b.value * a.error + a.error * b.error
        return rounded(a.value * b.value, error)

    def quotient(self, a: Rounded, b: Rounded) -> Rounded:
        value = a.value / b.value
        return rounded(value, (a.error - value * b.error) / (b.value + b.error))

    def function(self, name: str, a: Rounded) -> Rounded:
        # Slopes and values of these functions are at most 1.
        value = getattr(a.value, name)()
        return rounded(value if value.rad() < 1 else arb(0, 1), a.error, LIBRARY)


class Polynomials:
    """Exact arithmetic of quantities, functions, and an "other" value of the moved quantity."""

    def __init__(self, quantities: list[str]) -> None:
        self.names = [*quantities, "other", *(f"f{i}" for i in range(MOST_FUNCTIONS))]
        self.ring = fmpq_mpoly_ctx.get(self.names)
        self.variables = dict(zip(self.names, self.ring.gens(), strict=True))
        self.functions: dict[str, tuple[str, fmpq_mpoly, Terms]] = {}
        self.function_slope, self.moved = cache(self._function_slope), ""

    def moving(self, name: str) -> "Polynomials":
        """Returns the same arithmetic, in which the quantity `name` has its other value."""
        result = copy(self)
        result.moved = name
        return result

    def number(self, value: float) -> fmpq_mpoly:
        return self.ring.constant(fmpq(*value.as_integer_ratio()))

    def quantity(self, name: str) -> fmpq_mpoly:
        return self.variables["other" if name == self.moved else name]

    def product(self, a: fmpq_mpoly, b: fmpq_mpoly) -> fmpq_mpoly:
        refuse_unless(len(a) * len(b) <= MOST_TERMS, "a formula has too many terms")
        result = a * b
        is_small = not result or result.total_degree() <= MOST_FACTORS
        # Powers of powers of a number would fill the memory.
        is_small &= len(result) != 1 or result.coefficient(0).height_bits() <= MOST_BITS
        refuse_unless(is_small, "a formula multiplies too often")
        return result

    def quotient(self, a: fmpq_mpoly, b: fmpq_mpoly) -> fmpq_mpoly:
        return self.product(a, self.function("inverse", b))

    def function(self, name: str, inner: fmpq_mpoly) -> fmpq_mpoly:
        """Returns the variable that stands for a function of a polynomial."""
        for variable, known in self.functions.items():
            if known[:2] == (name, inner):
                return self.variables[variable]
        variable = f"f{len(self.functions)}"
        refuse_unless(variable in self.variables, "a policy has too many functions to check")
        self.functions[variable] = name, inner, self.terms(inner)
        return self.variables[variable]

    def slope(self, formula: fmpq_mpoly, name: str) -> fmpq_mpoly:
        """Differentiates by a quantity."""
        result = formula.derivative(name)
        for variable in {*self.functions} - {*formula.unused_gens()}:
            if inner_slope := self.function_slope(variable, name):
                result += self.product(formula.derivative(variable), inner_slope)
        return result

    def _function_slope(self, variable: str, name: str) -> fmpq_mpoly:
        function, inner, _ = self.functions[variable]
        inner_slope, value = self.slope(inner, name), self.variables[variable]
        if not inner_slope:
            return inner_slope
        derivatives = {
            "tanh": lambda: 1 - value**2,
            "sin": lambda: self.function("cos", inner),
            "cos": lambda: -self.function("sin", inner),
            "inverse": lambda: -(value**2),
        }
        return self.product(derivatives[function](), inner_slope)

    def terms(self, formula: fmpq_mpoly) -> Terms:
        """Returns the coefficient of each product of factors."""
        return {
            frozenset((self.names[i], power) for i, power in enumerate(powers) if power): arb(value)
            for powers, value in formula.to_dict().items()
        }

    def greatest(self, formula: fmpq_mpoly, box: Box, splits: Any, counted: Collection[str]) -> arb:
        """Bounds a polynomial from above over a box, cell by cell of a tree of splits."""
        terms = self.terms(formula)
        refuse_unless(len(terms) <= MOST_BOUNDED, "a formula has too many terms to be bounded")

        def over(cell: Box, splits: Any) -> arb:
            if not splits:
                return best(terms, self.spans(cell), MOST_TRIED)
            name, cut, below, above = splits
            low, high = cell[name]
            refuse_unless(low <= cut <= high, f"a split of {name} is outside of its cell")
            ends = (math.floor(cut), math.floor(cut) + 1) if name in counted else (cut, cut)
            first = over({**cell, name: (low, ends[0])}, below)
            return first.max(over({**cell, name: (ends[1], high)}, above))

        return over(box, splits)

    def spans(self, cell: Box) -> Callable[[Factor], Span]:
        """Returns the bounds of powers of variables over a cell."""

        @cache
        def span(factor: Factor) -> Span:
            name, power = factor
            if name in self.functions:
                function, _, terms = self.functions[name]
                spans = [reduce(multiplied, map(span, term), (c, c)) for term, c in terms.items()]
                low, high = (sum((ends[i] for ends in spans), arb(0)) for i in (0, 1))
                low, high = image(function, low, high)
            else:
                low, high = map(arb, cell[name])
            # An even power is least at 0.
            ends = [low**power, high**power]
            holds_zero = not (low > 0 or high < 0)
            return hull([*ends, arb(0)] if power % 2 == 0 and holds_zero else ends)

        return span


# Like the prover's function of this name, which the checker must not import.
def best(terms: Terms, span: Callable[[Factor], Span], n_tries: int) -> arb:
    """Bounds a polynomial from above, given the ends of its factors."""
    bound, rest = terms.get(frozenset(), arb(0)), {term for term in terms if term}
    while rest:
        # Gather the terms that share factors, directly or through others.
        group, added = set[frozenset[Factor]](), {next(iter(rest))}
        while added:
            group, rest = group | added, rest - added
            factors = frozenset().union(*added)
            added = {term for term in rest if term & factors}

        # Try both ends of the most frequent factor.
        if n_tries == 0:
            spans = (reduce(multiplied, map(span, t), (terms[t], terms[t])) for t in group)
            bound += sum((high for _, high in spans), arb(0))
            continue
        counts = Counter(factor for term in group for factor in term)
        factor = max(sorted(counts), key=counts.__getitem__)
        low, high = span(factor)
        bounds = []
        for end in [low.union(high)] if low.overlaps(high) else [low, high]:
            fixed: Terms = {}
            for term in group:
                value = terms[term] * end if factor in term else terms[term]
                fixed[term - {factor}] = fixed.get(term - {factor}, arb(0)) + value
            bounds.append(best(fixed, span, n_tries - 1))
        bound += reduce(arb.max, bounds)
    return bound


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
        # Maxima are at even values of `turns`, and minima at odd ones.
        half = fmpq(function == "sin", 2)
        turns: Any = [(end / arb.pi() - half).floor().unique_fmpz() for end in (low, high)]
        first, last = map(int, turns)
        ends += [arb((-1) ** (turn % 2)) for turn in range(first + 1, last + 1)[:2]]
    return hull(ends)
