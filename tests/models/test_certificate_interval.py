"""Interval arithmetic: results contain all values of a function of numbers in the intervals."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.formulas.interval import FUNCTIONS, Interval

NUMBERS = st.floats(-50.0, 50.0)
SHARES = st.floats(0.0, 1.0)


def interval(a: float, b: float) -> Interval:
    return Interval(np.array([min(a, b)]), np.array([max(a, b)]))


def within(a: float, b: float, share: float) -> float:
    low, high = min(a, b), max(a, b)
    return min(max(low + share * (high - low), low), high)


@given(NUMBERS, NUMBERS, NUMBERS, NUMBERS, SHARES, SHARES)
def test_sums_and_products_hold_those_of_all_numbers_inside(a, b, c, d, first, second):
    x, y = Fraction(within(a, b, first)), Fraction(within(c, d, second))
    left, right = interval(a, b), interval(c, d)
    for found, exact in (
        (left + right, x + y),
        (left - right, x - y),
        (left * right, x * y),
        (left.power(2), x * x),
        (left.power(3), x**3),
    ):
        assert Fraction(found.lower[0]) <= exact <= Fraction(found.upper[0])


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
@given(a=NUMBERS, b=NUMBERS, share=SHARES)
def test_functions_hold_their_values_at_all_numbers_inside(name, a, b, share):
    ctx.prec = 120
    x = within(a, b, share)
    found = FUNCTIONS[name](interval(a, b))
    if name == "inverse" and x == 0.0:
        return
    value = 1 / arb(x) if name == "inverse" else getattr(arb(x), name)()
    # Comparisons of balls are true only if certain: the value must not surely exceed an end.
    assert not value < arb(found.lower[0])
    assert not value > arb(found.upper[0])


def test_what_has_no_value_has_no_bound():
    assert interval(-1.0, 1.0).inverse().upper[0] == math.inf


def test_a_wave_has_its_crest_where_the_interval_holds_it():
    assert FUNCTIONS["sin"](interval(1.0, 2.0)).upper[0] == 1.0
    assert FUNCTIONS["sin"](interval(1.0, 1.5)).upper[0] < 1.0
    assert FUNCTIONS["cos"](interval(3.0, 3.5)).lower[0] == -1.0
    assert FUNCTIONS["sin"](interval(-1e7, 1e7)).upper[0] == 1.0
