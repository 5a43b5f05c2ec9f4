"""Formulas as trees, and compiled."""

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from models.errors import InputError
from models.policies.expression import UNARY, Expression, parse_expression, variable_names
from models.policies.symbolic import Tape

NAMES = variable_names(3)


def leaves():
    constants = st.floats(-5, 5).map(lambda value: Expression("constant", value=value))
    variables = st.integers(0, 2).map(lambda index: Expression("variable", variable=index))
    return constants | variables


def extend(children):
    binary = st.builds(
        lambda name, a, b: Expression(name, (a, b)), st.sampled_from(["add", "sub", "mul"]),
        children, children,
    )  # fmt: skip
    unary = st.builds(
        lambda name, a: Expression(name, (a,)),
        st.sampled_from(["sin", "tanh", "square", "cube", "neg"]),
        children,
    )
    return binary | unary


EXPRESSIONS = st.recursive(leaves(), extend, max_leaves=12)


@settings(max_examples=100, deadline=None)
@given(EXPRESSIONS)
def test_text_comes_back_with_the_same_values(expression):
    again = parse_expression(expression.to_text(NAMES), NAMES)
    rows = np.random.default_rng(0).normal(size=(5, 3))
    tape = Tape([expression, again], 3)(rows)
    np.testing.assert_array_equal(tape[:, 0], tape[:, 1])


@settings(max_examples=40, deadline=None)
@given(EXPRESSIONS)
def test_compiled_values_are_sympys(expression):
    symbols = sympy.symbols(NAMES)
    row = np.array([0.3, -0.7, 1.1])
    expected = float(expression.to_sympy(symbols).evalf(30, dict(zip(symbols, row, strict=True))))
    found = float(Tape([expression], 3)(row)[0])
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(max_examples=60, deadline=None)
@given(EXPRESSIONS, st.integers(0, 2))
def test_derivatives_are_sympys(expression, variable):
    symbols = sympy.symbols(NAMES)
    row = np.array([0.3, -0.7, 1.1])
    slope = sympy.diff(expression.to_sympy(symbols), symbols[variable])
    expected = float(slope.evalf(30, dict(zip(symbols, row, strict=True))))
    found = float(Tape([expression.derivative(variable)], 3)(row)[0])
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("function", UNARY)
def test_every_function_is_differentiated(function):
    row, step = np.array([0.4, 0.6, 0.8]), 1e-6
    formula = parse_expression(f"{function}(2 * x0 + x1) / (3 + x0)", NAMES)
    tape = Tape([formula], 3)
    nudge = np.array([step, 0.0, 0.0])
    expected = (tape(row + nudge) - tape(row - nudge)) / (2 * step)
    found = Tape([formula.derivative(0)], 3)(row)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@settings(max_examples=60, deadline=None)
@given(EXPRESSIONS)
def test_terms_add_up_to_the_formula(expression):
    rows = np.random.default_rng(0).normal(size=(5, 3))
    terms = expression.terms()
    assert not any(term.operator in ("add", "sub") for term in terms)
    whole = Tape([expression], 3)(rows)[:, 0]
    values = Tape(terms, 3)(rows)
    np.testing.assert_allclose(
        values.sum(axis=1), whole, rtol=1e-9, atol=1e-9 * np.abs(values).max()
    )


def test_size_counts_nodes_and_variables_are_listed():
    formula = parse_expression("2 * x0 + sin(x2)", NAMES)
    assert (formula.size, formula.length) == (6, 4)
    assert formula.variables == {0, 2}


def test_powers_and_signs_are_read():
    row = np.array([2.0, 3.0, 5.0])
    for text, value in (("-x0 ^ 2", -4), ("x1**3", 27), ("+x2 - -1", 6), ("(-0.5)*x0", -1)):
        assert Tape([parse_expression(text, NAMES)], 3)(row)[0] == value


def test_repeated_parts_are_evaluated_once():
    formula = parse_expression("sin(x0 + x1) * sin(x0 + x1)", NAMES)
    assert Tape([formula, formula], 3)._size == 3 + 0 + 3


@pytest.mark.parametrize(
    "text",
    [
        "x0 +",
        "x9",
        "open('f')",
        "x0.real",
        "x0 ** 4",
        "lambda: 0",
        "x0 if x1 else x2",
        "True",
        "[x0]",
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(InputError, match="fit it again"):
        parse_expression(text, NAMES)
