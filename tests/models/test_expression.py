"""Formulas as trees, and compiled."""

import pickle

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import (
    BINARY,
    MAX_DEPTH,
    MAX_NODES,
    MAX_TERMS,
    UNARY,
    Expression,
    refuse_unfit,
)
from glassgait.models.formulas.tape import Tape
from glassgait.models.formulas.text import parse_expression, variable_names

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


@given(EXPRESSIONS)
def test_text_comes_back_with_the_same_values(expression):
    again = parse_expression(expression.to_text(NAMES), NAMES)
    rows = np.random.default_rng(0).normal(size=(5, 3))
    tape = Tape([expression, again], 3)(rows)
    np.testing.assert_array_equal(tape[:, 0], tape[:, 1])


@settings(max_examples=40)
@given(EXPRESSIONS)
def test_compiled_values_are_sympys(expression):
    symbols = sympy.symbols(NAMES)
    row = np.array([0.3, -0.7, 1.1])
    expected = float(expression.to_sympy(symbols).evalf(30, dict(zip(symbols, row, strict=True))))
    found = float(Tape([expression], 3)(row)[0])
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@settings(max_examples=60)
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


@settings(max_examples=60)
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


def test_length_counts_a_weighted_variable_once_and_variables_are_listed():
    formula = parse_expression("2 * x0 + sin(x2)", NAMES)
    assert formula.length == 4
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
    with pytest.raises(InputError):
        parse_expression(text, NAMES)


@pytest.mark.parametrize(
    "text",
    [
        "tanh(" * 10_000 + "x0" + ")" * 10_000,
        "-" * 10_000 + "x0",
        "+".join(["x0"] * 20_000),
        "+".join(["x0"] * (MAX_DEPTH + 1)),
        "9" * 400,
        "9" * 5000,
        "1e999",
        "x0 * -1e999",
        "x0\0",
        "\ud800",
        "x0 + " + "open('f') + " * 1000 + "x1",
    ],
)
def test_what_is_too_large_for_a_formula_is_refused_in_one_short_sentence(text):
    with pytest.raises(InputError) as refused:
        parse_expression(text, NAMES)
    assert len(str(refused.value)) < 300
    assert "\n" not in str(refused.value)


def test_formulas_built_in_python_are_held_to_the_same_bounds():
    shared = Expression("variable", variable=0)
    for _ in range(60):
        shared = Expression("add", (shared, shared))
    with pytest.raises(InputError, match=f"more than {MAX_NODES} nodes"):
        refuse_unfit(shared, 3)
    deep = Expression("variable", variable=0)
    for _ in range(5000):
        deep = Expression("neg", (deep,))
    with pytest.raises(InputError, match=f"more than {MAX_DEPTH} deep"):
        refuse_unfit(deep, 3)
    for formula, message in (
        (Expression("constant", value=np.nan), "the number nan"),
        (Expression("variable", variable=3), "observation 3 of 3"),
        (Expression("add", (shared,)), "'add' to 1 operands"),
        (Expression("magic"), "'magic' to 0 operands"),
    ):
        with pytest.raises(InputError, match=message):
            refuse_unfit(formula, 3)


def deepest(operator: str) -> Expression:
    leaf = formula = Expression("variable", variable=0)
    for _ in range(MAX_DEPTH - 1):
        formula = Expression(operator, (formula,) if operator in UNARY else (formula, leaf))
    return formula


@pytest.mark.parametrize("operator", [*UNARY, *BINARY])
def test_the_deepest_formulas_can_be_used(operator):
    formula = deepest(operator)
    assert parse_expression(formula.to_text(NAMES), NAMES) == formula
    assert pickle.loads(pickle.dumps(formula)) == formula
    assert formula.length >= MAX_DEPTH
    rows = np.random.default_rng(0).normal(size=(5, 3))
    whole = Tape([formula], 3)(rows)[:, 0]
    np.testing.assert_allclose(Tape(formula.terms(), 3)(rows).sum(axis=1), whole)
    assert Tape([formula.derivative(0)], 3)(rows).shape == (5, 1)
    assert formula.to_sympy(sympy.symbols(NAMES)).free_symbols <= set(sympy.symbols(NAMES))


def test_products_of_many_sums_stay_whole():
    product = " * ".join(f"(x{i % 3} + {i}.5)" for i in range(22))
    formula = parse_expression(f"x0 + 3 * x1 - {product}", NAMES)
    assert formula.n_terms == 2 + 2**22
    terms = formula.terms()
    assert len(terms) == 3
    rows = np.random.default_rng(0).normal(size=(5, 3))
    whole = Tape([formula], 3)(rows)[:, 0]
    np.testing.assert_allclose(Tape(terms, 3)(rows).sum(axis=1), whole, rtol=1e-12)


def test_products_are_multiplied_out_up_to_the_greatest_number_of_terms():
    factors = " * ".join(["(x0 + 1)"] * 9)
    formula = parse_expression(factors, NAMES)
    assert len(formula.terms()) == formula.n_terms == 512 <= MAX_TERMS
