"""Numbers of formula files: where they stand, and policies that act by others."""

import numpy as np
import pytest

from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import ZERO, canonical
from glassgait.models.formulas.grammar import parse_formula
from glassgait.models.formulas.numbers import (
    WeightedSum,
    numbers_of,
    with_numbers,
)
from glassgait.models.policies.library import load_student


def test_numbers_stand_from_left_to_right():
    formula = parse_formula("0.5 - 0.25*a + tanh(2*b - 3)", ("a", "b"))
    assert [*numbers_of(formula)] == [0.5, 0.25, 2.0, 3.0]
    again = canonical(with_numbers(formula, iter([0.5, -0.25, 2.0, 3.0])))
    assert again == parse_formula("0.5 + 0.25*a + tanh(2*b - 3)", ("a", "b"))


@pytest.mark.parametrize(
    ("text", "terms", "rest"),
    [
        ("0.5 - 0.25*a + 3*tanh(b)", ["1", "-a", "tanh(b)"], "0"),
        ("a*(0.5 + 2*b) - 0.1/b", ["a", "a*b", "-(1/b)"], "0"),
        ("-(0.5 + a) + (b - 2)*b", ["1", "-b"], "-a + b*b"),
        ("a + sin(b)/a", [], "a + sin(b)/a"),
    ],
)
def test_what_each_number_multiplies(text, terms, rest):
    formula = parse_formula(text, ("a", "b"))
    own = WeightedSum.of(formula)
    assert own is not None and len(own.terms) == len(terms)
    points = np.random.default_rng(1).uniform(0.5, 2.0, (20, 2))
    expected = [parse_formula(term, ("a", "b")) for term in (*terms, rest)]
    values = Tape([*own.terms, own.rest], 2)(points)
    np.testing.assert_allclose(values, Tape(expected, 2)(points), atol=1e-12)
    whole = values @ np.array([*numbers_of(formula), 1.0])
    np.testing.assert_allclose(whole, Tape([formula], 2)(points)[:, 0], atol=1e-12)


@pytest.mark.parametrize("text", ["tanh(2*a)", "0.5*(a + 2)", "a/(b + 1)", "a + (3*b)**2"])
def test_numbers_that_are_no_weights(text):
    assert WeightedSum.of(parse_formula(text, ("a", "b"))) is None


@pytest.mark.parametrize("kind", ["sparse_formula", "statewise_symbolic"])
def test_formulas_that_ship_are_weighted_sums(kind):
    for formula in load_student("pace", kind).to_file().written().values():
        own = WeightedSum.of(formula)
        assert own is not None and own.rest == ZERO
