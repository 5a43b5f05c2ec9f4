"""Prover and checker find the best corner of a polynomial, or else a bound."""

from fractions import Fraction
from itertools import product
from math import prod

import numpy as np
import pytest
from flint import arb
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.certificates import polynomial as polynomials
from glassgait.models.certificates.checker import bounds
from glassgait.models.certificates.polynomial import Polynomial, PolynomialRing, Relaxation
from glassgait.models.formulas.expression import variable

N = 6
ENDS = st.tuples(st.integers(-8, 8), st.integers(0, 8))
POLYNOMIALS = st.dictionaries(
    st.frozensets(st.integers(0, N - 1), max_size=3), st.integers(-9, 9), min_size=1, max_size=14
)
BOXES = st.lists(ENDS, min_size=N, max_size=N)
COMPLETE = {
    frozenset([i, j]): (-1) ** (i * j) * (3 + i + 2 * j) for i in range(N) for j in range(i)
}

Terms = dict[frozenset[int], int]


def best_corner(terms: Terms, lower: np.ndarray, upper: np.ndarray) -> float:
    corners = product(*zip(lower, upper, strict=True))
    return max(
        sum(value * prod(corner[i] for i in own) for own, value in terms.items())
        for corner in corners
    )


def proved(terms: Terms, lower: np.ndarray, upper: np.ndarray) -> float:
    ring = PolynomialRing()
    numbers = {i: next(iter(ring.polynomial(variable(i))))[0] for i in range(N)}
    polynomial: Polynomial = {
        tuple(sorted(numbers[i] for i in own)): Fraction(value) for own, value in terms.items()
    }
    (found,) = Relaxation(ring, polynomial).upper(lower[None], upper[None])
    return float(found)


def checked(terms: Terms, lower: np.ndarray, upper: np.ndarray) -> float:
    named = {frozenset((str(i), 1) for i in own): arb(value) for own, value in terms.items()}

    def span(factor: tuple[str, int]) -> tuple[arb, arb]:
        return arb(lower[int(factor[0])]), arb(upper[int(factor[0])])

    return float(bounds.best(named, span, bounds.MOST_TRIED))


def box(ends: list[tuple[int, int]]) -> tuple[np.ndarray, np.ndarray]:
    lower = np.array([low for low, _ in ends], dtype=float)
    return lower, lower + np.array([width for _, width in ends])


@given(POLYNOMIALS, BOXES)
def test_the_best_corner_is_found(terms, ends):
    lower, upper = box(ends)
    best = best_corner(terms, lower, upper)
    assert checked(terms, lower, upper) == best
    assert best <= proved(terms, lower, upper) <= best + 1e-9


@pytest.mark.parametrize("most", [0, 1, 2])
def test_where_few_factors_are_tried_a_bound_is_looser(monkeypatch, most):
    monkeypatch.setattr(polynomials, "MOST_TRIED", most)
    monkeypatch.setattr(bounds, "MOST_TRIED", most)
    generator = np.random.default_rng(0)
    loose = 0
    for _ in range(20):
        lower, upper = box(generator.integers((-8, 0), (9, 9), (N, 2)).tolist())
        best, bound = best_corner(COMPLETE, lower, upper), checked(COMPLETE, lower, upper)
        assert bound >= best
        assert proved(COMPLETE, lower, upper) >= best
        loose += bound > best
    assert loose > 0


def test_a_product_of_many_factors_is_bounded_by_little_work():
    terms = {frozenset(range(40)): 1}
    lower, upper = np.full(40, -1.0), np.full(40, 2.0)
    assert checked(terms, lower, upper) == 2.0**40
    ring = PolynomialRing()
    whole = tuple((next(iter(ring.polynomial(variable(i))))[0][0], 1) for i in range(40))
    (found,) = Relaxation(ring, {whole: Fraction(1)}).upper(lower[None], upper[None])
    assert found == pytest.approx(2.0**40)
