"""Compiled formulas: the same last digit as one operation after the other, for one row or many."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.formulas.expression import Expression, constant, variable
from glassgait.models.formulas.tape import BLOCK, Tape

N = 4

PLAIN = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sin": np.sin,
    "tanh": np.tanh,
    "abs": np.abs,
    "square": np.square,
    "cube": lambda x: x * x * x,
}

LEAVES = st.one_of(
    st.integers(0, N - 1).map(variable),
    st.floats(-3.0, 3.0, allow_nan=False).map(constant),
)


def grown(parts):
    binary = st.tuples(st.sampled_from(["add", "sub", "mul", "div"]), st.tuples(parts, parts))
    unary = st.tuples(st.sampled_from(["neg", "sin", "tanh", "abs", "square", "cube"]), parts)
    return st.one_of(
        binary.map(lambda own: Expression(own[0], own[1])),
        unary.map(lambda own: Expression(own[0], (own[1],))),
    )


FORMULAS = st.recursive(LEAVES, grown, max_leaves=25)


def in_order(formula, row):
    """Evaluates a formula one operation after the other."""
    if formula.operator == "constant":
        return np.float64(formula.value)
    if formula.operator == "variable":
        return row[formula.variable]
    with np.errstate(all="ignore"):
        return PLAIN[formula.operator](*(in_order(operand, row) for operand in formula.operands))


@given(formulas=st.lists(FORMULAS, min_size=1, max_size=6), seed=st.integers(0, 2**31 - 1))
def test_every_digit_is_that_of_one_operation_after_the_other(formulas, seed):
    rows = np.random.default_rng(seed).normal(size=(5, N))
    tape = Tape(formulas, N)
    together = tape(rows)
    for row, values in zip(rows, together, strict=True):
        # Signs of zeros count, too: a quotient by one of them is infinite, this way or that.
        np.testing.assert_array_equal(tape(row), values)
        expected = [in_order(formula, row) for formula in formulas]
        np.testing.assert_array_equal(values, expected)


def test_zeros_keep_their_signs():
    minus_zero = Expression("neg", (constant(0.0),))
    infinite = Expression("div", (variable(0), minus_zero))
    tape = Tape(
        [infinite, Expression("div", (variable(0), Expression("add", (minus_zero, minus_zero))))], 1
    )
    np.testing.assert_array_equal(tape(np.ones(1)), [-np.inf, -np.inf])
    np.testing.assert_array_equal(tape(np.ones((2, 1))), np.full((2, 2), -np.inf))


def test_a_long_sum_is_taken_from_left_to_right():
    # In pairs, or from the right, the small ones would not be lost.
    total = constant(1e16)
    for _ in range(40):
        total = Expression("add", (total, variable(0)))
    assert Tape([total], 1)(np.array([1.0])) == pytest.approx([1e16], abs=0.0)
    assert Tape([total], 1)(np.ones((3, 1))) == pytest.approx(np.full((3, 1), 1e16), abs=0.0)


def test_a_thousand_terms_are_one_instruction():
    total = variable(0)
    for number in range(1000):
        total = Expression("sub", (total, Expression("mul", (constant(number), variable(1)))))
    tape = Tape([total], 2)
    # The products, and their sum.
    assert len(tape._instructions) == 2
    assert tape(np.array([0.5, 2.0])) == pytest.approx([0.5 - 2.0 * 499500])


def test_shapes_of_observations_stay():
    tape = Tape([variable(1), Expression("mul", (variable(0), variable(1)))], 2)
    assert tape(np.ones(2)).shape == (2,)
    assert tape(np.ones((3, 2))).shape == (3, 2)
    assert tape(np.ones((4, 3, 2))).shape == (4, 3, 2)
    assert tape(np.ones((0, 2))).shape == (0, 2)
    assert Tape([], 2)(np.ones(2)).shape == (0,)


def test_rows_of_every_block_are_evaluated(generator):
    tape = Tape([Expression("mul", (variable(0), variable(1)))], 2)
    rows = generator.normal(size=(2 * BLOCK + 3, 2))
    np.testing.assert_array_equal(tape(rows)[:, 0], rows[:, 0] * rows[:, 1])
