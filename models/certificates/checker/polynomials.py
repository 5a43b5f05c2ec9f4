"""Polynomials of quantities and of functions of them, with exact coefficients.

A polynomial maps monomials, ((factor, power), …), to fractions. A factor is the name of a quantity,
or the text of a function; what that is of, `INNER` holds.
"""

import math
from typing import Any

from flint import fmpq

INNER: dict[str, tuple[str, dict]] = {}

MOST_TERMS = 20_000


class RefusedError(Exception):
    """A certificate that does not hold, told in one sentence."""


def refuse_unless(holds: Any, sentence: str) -> None:
    """Refuses what does not hold."""
    if not holds:
        raise RefusedError(sentence)


def exact(number: float) -> Any:
    """Returns the fraction that a double is."""
    refuse_unless(math.isfinite(number), f"{number} is no number")
    return fmpq(*float(number).as_integer_ratio())


def constant(number: Any) -> dict:
    return {(): number} if number else {}


def quantity(name: str) -> dict:
    return {((name, 1),): fmpq(1)}


def plus(left: dict, right: dict, factor: Any = 1) -> dict:
    whole = dict(left)
    for monomial, number in right.items():
        whole[monomial] = whole.get(monomial, fmpq(0)) + factor * number
    return {monomial: number for monomial, number in whole.items() if number}


def times(left: dict, right: dict) -> dict:
    refuse_unless(len(left) * len(right) <= MOST_TERMS, "a formula has too many terms to check")
    whole: dict = {}
    for one, a in left.items():
        for other, b in right.items():
            powers = dict(one)
            for factor, power in other:
                powers[factor] = powers.get(factor, 0) + power
            monomial = tuple(sorted(powers.items()))
            whole[monomial] = whole.get(monomial, fmpq(0)) + a * b
    return {monomial: number for monomial, number in whole.items() if number}


def applied(function: str, inner: dict) -> dict:
    if function == "inverse" and set(inner) == {()}:
        return constant(1 / inner[()])
    text = f"{function}{sorted((m, str(number)) for m, number in inner.items())}"
    INNER[text] = (function, inner)
    return quantity(text)


def substituted(polynomial: dict, put: dict[str, dict]) -> dict:
    """Puts polynomials in the place of quantities."""
    whole: dict = {}
    for monomial, number in polynomial.items():
        part = constant(number)
        for factor, power in monomial:
            if factor in INNER:
                function, inner = INNER[factor]
                new = applied(function, substituted(inner, put))
            else:
                new = put.get(factor, quantity(factor))
            for _ in range(power):
                part = times(part, new)
        whole = plus(whole, part)
    return whole


def names_in(polynomial: dict) -> set[str]:
    """Returns the quantities that a polynomial is of."""
    found: set[str] = set()
    for factor in {factor for monomial in polynomial for factor, _ in monomial}:
        found |= names_in(INNER[factor][1]) if factor in INNER else {factor}
    return found


def slope(polynomial: dict, name: str) -> dict:
    """Differentiates by a quantity."""
    whole: dict = {}
    for monomial, number in polynomial.items():
        for factor, power in monomial:
            rest = {k: p - (k == factor) for k, p in monomial}
            outer = {tuple(sorted((k, p) for k, p in rest.items() if p)): number * power}
            whole = plus(whole, times(outer, factor_slope(factor, name)))
    return whole


def factor_slope(factor: str, name: str) -> dict:
    if factor not in INNER:
        return constant(fmpq(1)) if factor == name else {}
    function, inner = INNER[factor]
    along = slope(inner, name)
    if not along:
        return {}
    whole, square = quantity(factor), {((factor, 2),): fmpq(-1)}
    outer = {
        "tanh": lambda: plus(constant(fmpq(1)), square),
        "sin": lambda: applied("cos", inner),
        "cos": lambda: times(constant(fmpq(-1)), applied("sin", inner)),
        "exp": lambda: whole,
        "inverse": lambda: square,
        "log": lambda: applied("inverse", inner),
        "sqrt": lambda: times(constant(fmpq(1, 2)), applied("inverse", whole)),
    }
    refuse_unless(function in outer, f"slopes of {function} are not checked")
    return times(outer[function](), along)
