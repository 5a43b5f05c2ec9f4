"""Canonical form: one tree for each formula, its minus signs in front, its values untouched."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.formulas.expression import (
    BINARY,
    Expression,
    canonical,
    constant,
    is_negative,
    negative,
    variable,
)
from glassgait.models.formulas.tape import Tape
from glassgait.models.formulas.text import parse_expression, variable_names

N = 3
NAMES = variable_names(N)
X, Y, _ = (variable(index) for index in range(N))
MINUS_X = Expression("neg", (X,))


def nodes(formula):
    yield formula
    for operand in formula.operands:
        yield from nodes(operand)


def values(formulas, rows):
    return Tape(list(formulas), N)(rows)


def divisors(formula):
    return [node.operands[1] for node in nodes(formula) if node.operator == "div"]


def random_rows(seed):
    generator = np.random.default_rng(seed)
    return generator.normal(size=(20, N)) * 10.0 ** generator.integers(-3, 4, size=(20, N))


@given(st.data())
def test_canonical_formulas_stay_as_they_are(random_formulas, data):
    formula = canonical(data.draw(random_formulas(N)))
    assert canonical(formula) == formula


@given(st.data(), st.integers(0, 2**32 - 1))
def test_canonical_form_changes_no_value(random_formulas, data, seed):
    formula, rows = data.draw(random_formulas(N)), random_rows(seed)
    # Of a zero the sign may change, and then that of what is divided by it.
    rows = rows[(values(divisors(formula), rows) != 0.0).all(axis=1)]
    before, after = values([formula], rows), values([canonical(formula)], rows)
    np.testing.assert_array_equal(after, before)


@given(st.data(), st.integers(0, 2**32 - 1))
def test_the_negative_of_the_negative_is_the_formula(random_formulas, data, seed):
    formula, rows = canonical(data.draw(random_formulas(N))), random_rows(seed)
    other = negative(formula)
    assert canonical(other) == other
    assert negative(other) == formula
    np.testing.assert_array_equal(values([other], rows), -values([formula], rows))


@given(st.data())
def test_no_term_no_factor_and_no_sum_has_a_sign_before_it(random_formulas, data):
    for node in nodes(canonical(data.draw(random_formulas(N)))):
        if node.operator in ("add", "sub", "mul"):
            assert not is_negative(node.operands[1])
        if node.operator == "neg":
            assert node.operands[0].operator not in ("constant", "neg", *BINARY)


@pytest.mark.parametrize("operator", ["neg", "sin", "square"])
def test_no_zero_is_below_zero(operator):
    formula = canonical(Expression(operator, (constant(-0.0),)))
    assert not any(np.signbit(node.value) for node in nodes(formula))


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("x0 + (-2.0)*x1", "x0 - 2.0*x1"),
        ("x0 - (-2.0)*x1", "x0 + 2.0*x1"),
        ("x0 + -x1", "x0 - x1"),
        ("x0 * -x1", "-x0 * x1"),
        ("-x0 * -x1", "x0 * x1"),
        ("x0 / -3.0", "x0 / -3.0"),
        ("-(2.0*x0)", "-2.0*x0"),
        ("-(x0 + x1)", "-x0 - x1"),
        ("-(x0 - x1 - 1.0)", "-x0 + x1 + 1.0"),
        ("-(x0 + x1) * x2", "(-x0 - x1) * x2"),
        ("x2 * (-x0 + x1)", "x2 * (-x0 + x1)"),
        ("-(-x0)", "x0"),
        ("-x0**2", "-(x0**2)"),
        ("sin(-x0)", "sin(-x0)"),
        ("(-x0)**3", "(-x0)**3"),
        ("-0.0", "0.0"),
    ],
)
def test_signs_move_to_the_front(text, same):
    assert canonical(parse_expression(text, NAMES)) == parse_expression(same, NAMES)


def test_a_sign_is_before_all_of_a_formula_or_before_a_part():
    for negated in (constant(-1.0), MINUS_X, Expression("mul", (MINUS_X, Y))):
        assert is_negative(negated)
    for other in (constant(0.0), X, Expression("add", (MINUS_X, Y)), Expression("sin", (MINUS_X,))):
        assert not is_negative(other)
