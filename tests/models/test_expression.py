"""Formulas as trees: canonical form, terms, derivatives, limits of size, and evaluation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import BLOCK, Tape
from glassgait.models.formulas.expression import (
    BINARY,
    MAX_DEPTH,
    MAX_NODES,
    MAX_TERMS,
    UNARY,
    Expression,
    WeightedSum,
    canonical,
    constant,
    is_negative,
    negative,
    numbers_of,
    refuse_unfit,
    variable,
)
from glassgait.models.formulas.grammar import parse_expression, variable_names

N = 3
NAMES = variable_names(N)

PLAIN = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "cube": lambda x: x * x * x,
    **{name: getattr(np, name) for name in UNARY if name not in ("neg", "cube")},
}


def read(text):
    return parse_expression(text, NAMES)


def nodes(formula):
    yield formula
    for operand in formula.operands:
        yield from nodes(operand)


def values(formulas, rows):
    return Tape(list(formulas), N)(rows)


def random_rows(seed, count=20):
    generator = np.random.default_rng(seed)
    return generator.normal(size=(count, N)) * 10.0 ** generator.integers(-3, 4, size=(count, N))


def in_order(formula, row):
    """Evaluates a formula recursively, one operation at a time."""
    if formula.operator == "constant":
        return np.float64(formula.value)
    if formula.operator == "variable":
        return row[formula.variable]
    with np.errstate(all="ignore"):
        return PLAIN[formula.operator](*(in_order(operand, row) for operand in formula.operands))


@given(st.data(), st.integers(0, 2**31 - 1))
def test_every_digit_is_that_of_one_operation_after_the_other(random_formulas, data, seed):
    formulas = data.draw(st.lists(random_formulas(N, 25), min_size=1, max_size=6))
    rows, tape = random_rows(seed, 5), Tape(formulas, N)
    for row, together in zip(rows, tape(rows), strict=True):
        # The signs of zeros count, too: they decide the signs of infinite quotients.
        np.testing.assert_array_equal(tape(row), together)
        np.testing.assert_array_equal(together, [in_order(formula, row) for formula in formulas])


def test_a_long_sum_is_taken_from_left_to_right():
    # If added in pairs or from the right, the small numbers would not be lost.
    total = constant(1e16)
    for _ in range(40):
        total = Expression("add", (total, variable(0)))
    assert Tape([total], 1)(np.array([1.0])) == pytest.approx([1e16], abs=0.0)
    assert Tape([total], 1)(np.ones((3, 1))) == pytest.approx(np.full((3, 1), 1e16), abs=0.0)


@pytest.mark.parametrize("shape", [(), (3,), (4, 3), (0,), (2 * BLOCK + 3,)])
def test_shapes_of_observations_stay(shape, generator):
    rows = generator.normal(size=(*shape, 2))
    found = Tape([variable(1), Expression("mul", (variable(0), variable(1)))], 2)(rows)
    np.testing.assert_array_equal(found[..., 1], rows[..., 0] * rows[..., 1])
    assert found.shape == (*shape, 2)


@pytest.mark.parametrize("function", UNARY)
def test_every_function_is_differentiated(function):
    row, step = np.array([0.4, 0.6, 0.8]), 1e-6
    formula = read(f"{function}(2 * x0 + x1) / (3 + x0) - x0 * x2")
    tape = Tape([formula], N)
    nudge = np.array([step, 0.0, 0.0])
    expected = (tape(row + nudge) - tape(row - nudge)) / (2 * step)
    np.testing.assert_allclose(Tape([formula.derivative(0)], N)(row), expected, rtol=1e-6)


@given(st.data())
def test_terms_add_up_to_the_formula(random_formulas, data):
    formula, rows = data.draw(random_formulas(N)), random_rows(0, 5)
    terms = formula.terms()
    assert not any(term.operator in ("add", "sub") for term in terms)
    whole, parts = values([formula], rows)[:, 0], values(terms, rows)
    with np.errstate(all="ignore"):
        scale = np.abs(parts).sum(axis=1)
        error = np.abs(parts.sum(axis=1) - whole)
    finite = np.isfinite(scale) & np.isfinite(whole)
    # Terms of products that are multiplied out may cancel.
    assert (error[finite] <= 1e-9 * scale[finite]).all()


def test_products_of_many_sums_stay_whole():
    product = " * ".join(f"(x{i % 3} + {i}.5)" for i in range(22))
    formula = read(f"x0 + 3 * x1 - {product}")
    assert formula.n_terms == 2 + 2**22
    assert len(formula.terms()) == 3
    assert len(read(" * ".join(["(x0 + 1)"] * 9)).terms()) == 512 <= MAX_TERMS


@given(st.data(), st.integers(0, 2**32 - 1))
def test_canonical_form_changes_no_value(random_formulas, data, seed):
    formula, rows = data.draw(random_formulas(N)), random_rows(seed)
    same = canonical(formula)
    assert canonical(same) == same
    # Only the sign of a zero may change, and the sign of a quotient by it.
    divisors = [node.operands[1] for node in nodes(formula) if node.operator == "div"]
    rows = rows[(values(divisors, rows) != 0.0).all(axis=1)]
    np.testing.assert_array_equal(values([same], rows), values([formula], rows))
    other = negative(same)
    assert canonical(other) == other
    assert negative(other) == same
    np.testing.assert_array_equal(values([other], rows), -values([same], rows))


@given(st.data())
def test_no_term_no_factor_and_no_sum_has_a_sign_before_it(random_formulas, data):
    for node in nodes(canonical(data.draw(random_formulas(N)))):
        if node.operator in ("add", "sub", "mul"):
            assert not is_negative(node.operands[1])
        if node.operator == "neg":
            assert node.operands[0].operator not in ("constant", "neg", *BINARY)
        assert node.operator != "constant" or math.copysign(1.0, node.value) > 0 or node.value


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("x0 + (-2.0)*x1", "x0 - 2.0*x1"),
        ("x0 - (-2.0)*x1", "x0 + 2.0*x1"),
        ("x0 * -x1", "-x0 * x1"),
        ("-x0 * -x1", "x0 * x1"),
        ("x0 / -3.0", "x0 / -3.0"),
        ("-(x0 - x1 - 1.0)", "-x0 + x1 + 1.0"),
        ("-(x0 + x1) * x2", "(-x0 - x1) * x2"),
        ("-x0 ^ 2", "-(x0**2)"),
        ("(-x0)**3", "(-x0)**3"),
        ("-0.0", "0.0"),
    ],
)
def test_signs_move_to_the_front(text, same):
    assert canonical(read(text)) == read(same)


@pytest.mark.parametrize("operator", [*UNARY, *BINARY])
def test_the_deepest_formulas_can_be_used(operator):
    leaf = formula = variable(0)
    for _ in range(MAX_DEPTH - 1):
        formula = Expression(operator, (formula,) if operator in UNARY else (formula, leaf))
    refuse_unfit(formula, N)
    assert formula.length >= MAX_DEPTH
    rows = np.random.default_rng(0).normal(size=(5, N))
    whole = values([formula], rows)[:, 0]
    np.testing.assert_allclose(values(formula.terms(), rows).sum(axis=1), whole)
    assert values([formula.derivative(0), canonical(formula)], rows).shape == (5, 2)


def test_formulas_that_are_too_large_or_of_no_known_operator_are_refused():
    shared = variable(0)
    for _ in range(60):
        shared = Expression("add", (shared, shared))
    deep = variable(0)
    for _ in range(5000):
        deep = Expression("neg", (deep,))
    for formula, message in (
        (shared, f"more than {MAX_NODES} nodes"),
        (deep, f"more than {MAX_DEPTH} deep"),
        (constant(np.nan), "the number nan"),
        (variable(3), "observation 3 of 3"),
        (Expression("add", (variable(0),)), "'add' to 1 operands"),
        (Expression("magic"), "'magic' to 0 operands"),
    ):
        with pytest.raises(InputError, match=message):
            refuse_unfit(formula, N)


@pytest.mark.parametrize(
    ("text", "terms", "rest"),
    [
        ("0.5 - 0.25*x0 + 3*tanh(x1)", ["1", "-x0", "tanh(x1)"], "0"),
        ("x0*(0.5 + 2*x1) - 0.1/x1", ["x0", "x0*x1", "-(1/x1)"], "0"),
        ("-(0.5 + x0) + (x1 - 2)*x1", ["1", "-x1"], "-x0 + x1*x1"),
        ("x0 + sin(x1)/x0", [], "x0 + sin(x1)/x0"),
    ],
)
def test_a_weighted_sum_holds_what_each_number_multiplies(text, terms, rest):
    formula = canonical(read(text))
    found = WeightedSum.of(formula)
    assert found is not None and len(found.terms) == len(terms)
    points = np.random.default_rng(1).uniform(0.5, 2.0, (20, N))
    parts = values([*found.terms, found.rest], points)
    np.testing.assert_allclose(parts, values([read(own) for own in (*terms, rest)], points))
    whole = parts @ np.array([*numbers_of(formula), 1.0])
    np.testing.assert_allclose(whole, values([formula], points)[:, 0], atol=1e-12)


@pytest.mark.parametrize("text", ["tanh(2*x0)", "0.5*(x0 + 2)", "x0/(x1 + 1)", "x0 + (3*x1)**2"])
def test_numbers_in_functions_and_products_are_no_weights(text):
    assert WeightedSum.of(read(text)) is None
