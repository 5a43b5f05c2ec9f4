"""The notation of formulas: text to tree and back, and the places of errors."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import (
    BINARY,
    LARGEST,
    MAX_DEPTH,
    UNARY,
    Expression,
    canonical,
    constant,
    variable,
)
from glassgait.models.formulas.grammar import (
    LINE_LENGTH,
    SIGNS,
    TextError,
    parse_expression,
    parse_formula,
    variable_names,
    write_formula,
    written_lines,
    written_number,
)
from glassgait.models.formulas.quantities import Vocabulary, known_definitions
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
SYMBOLS = Vocabulary(NAMES, known_definitions(load_robot(), NAMES)).symbols


def read(text):
    return parse_formula(text, SYMBOLS)


@given(st.data())
def test_formulas_come_back_from_their_text(random_formulas, data):
    formula = canonical(data.draw(random_formulas(len(SYMBOLS))))
    text = write_formula(formula, SYMBOLS)
    assert read(text) == formula
    assert write_formula(read(text), SYMBOLS) == text


@pytest.mark.parametrize("operator", [*UNARY, *BINARY])
@pytest.mark.parametrize("side", [0, 1])
def test_the_deepest_formulas_come_back(operator, side):
    leaf = formula = variable(0)
    for _ in range(MAX_DEPTH - 1):
        operands = (leaf, formula) if side else (formula, leaf)
        formula = Expression(operator, operands if operator in BINARY else (formula,))
    formula = canonical(formula)
    assert read(write_formula(formula, SYMBOLS)) == formula


def test_a_formula_that_a_sign_makes_too_deep_to_be_read_is_refused():
    deep = variable(0)
    for _ in range(MAX_DEPTH - 2):
        deep = Expression("tanh", (deep,))
    product = Expression("mul", (deep, Expression("neg", (variable(1),))))
    with pytest.raises(TextError, match="nested more than 100 deep"):
        read(write_formula(product, SYMBOLS))
    with pytest.raises(InputError, match="nested more than 100 deep"):
        SymbolicPolicy("trot", NAMES, [[product] * 12])


@given(st.floats(-LARGEST, LARGEST))
def test_a_number_keeps_all_its_digits(value):
    assert float(written_number(value)) == value
    assert read(written_number(value)) == constant(value)


@pytest.mark.parametrize(
    "text",
    [
        "0.0412 + 0.52*q.FL_hip - 0.013*dq.FL_hip + late*(0.1 - 0.2*cmd.yaw)",
        "t - (s0 - s1)",
        "t*s0/s1*cmd.t",
        "t/(s0*s1)",
        "(t + s0)*(t - s1)",
        "-t*s0 - s1",
        "-t**2",
        "(-2)**3",
        "(2*t)**3",
        "-(t**2)**3",
        "exp(log(sqrt(cos(abs(-t)))))",
        "1e-05*t + 2.5e+20",
    ],
)
def test_these_texts_are_written_as_they_stand(text):
    assert write_formula(read(text), SYMBOLS) == text


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("((t))+(s0*s1)", "t + s0*s1"),
        ("t + -2*s0", "t - 2*s0"),
        ("t*-2", "-t*2"),
        ("-(t + 1)", "-t - 1"),
        ("+t", "t"),
        ("t ** 2", "t**2"),
        ("2.50*t", "2.5*t"),
        (" t # in control steps\n  + s0 # or not\n", "t + s0"),
    ],
)
def test_other_ways_to_write_a_formula_are_read(text, plain):
    assert write_formula(read(text), SYMBOLS) == plain


@given(st.data())
def test_lines_end_only_before_signs(random_formulas, data):
    formulas = st.lists(random_formulas(len(SYMBOLS), 6), min_size=1, max_size=20)
    formula, *others = data.draw(formulas)
    for other in others:
        formula = Expression("add", (formula, other))
    formula = canonical(formula)
    first, *rest = lines = written_lines("FL_hip = ", formula, SYMBOLS)
    for line in lines:
        # A line may be too long only if it has no sign to end before.
        assert len(line) <= LINE_LENGTH or not any(sign in line[6:] for sign in SIGNS)
    assert first.startswith("FL_hip = ")
    assert all(line.startswith(("    + ", "    - ")) for line in rest)
    assert read("\n".join(lines).removeprefix("FL_hip =")) == formula


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("0.5*foo + t", 1, 5, "unknown name 'foo'; there are cmd.…, q.…"),
        ("t + q.FL_foot", 1, 5, "'q.FL_foot'; there are q.FL_hip, q.FL_thigh"),
        ("t # foo\n\n + 2*foo", 3, 6, "'foo'"),
        ("t**4", 1, 2, "does not belong"),
        ("2*tan(t)", 1, 3, "'tan' does not belong"),
        ("sin(t, s0)", 1, 6, "',' does not belong"),
        ("t(3)", 1, 1, "does not belong"),
        ("t + 'late'", 1, 5, "does not belong"),
        ("1e31*t", 1, 1, r"from -1e\+30 to 1e\+30"),
        ("t - " + "9" * 400, 1, 5, r"from -1e\+30 to 1e\+30"),
        ("1.0t", 1, 1, "'1.0t' is not a number"),
        ("007", 1, 1, "not a number"),
        ("t if s0 else s1", 1, 3, "does not belong"),
        ("t + é", 1, 5, "'é' does not belong in a formula"),
        ("t + ", 1, 4, "ends before it is complete"),
        ("", 1, 1, "there is no formula"),
        ("t +\n    s0)", 2, 7, "never opened"),
        ("sin(t)) + 1", 1, 7, "never opened"),
        ("2*(t + 1", 1, 3, "never closed"),
        ("tanh(" * 150 + "t" + ")" * 150, 1, 505, "more than 100 deep"),
        ("(" * 20_000, 1, 101, "more than 100 deep"),
        ("-" * 20_000 + "t", 1, 1, "nested more than 100 deep"),
        ("+".join(["t"] * 20_000), 1, 1, "nested more than 100 deep"),
    ],
)
def test_what_is_wrong_is_refused_with_its_place(text, line, column, message):
    with pytest.raises(TextError, match=message) as refused:
        read(text)
    assert (refused.value.line, refused.value.column) == (line, column)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 300


def test_engines_of_symbolic_regression_are_read():
    names = variable_names(2)
    found = parse_expression("square(x0 ^ 3) - -1.5 * neg(x1)", names)
    square = Expression("square", (Expression("cube", (variable(0),)),))
    product = Expression("mul", (constant(-1.5), Expression("neg", (variable(1),))))
    assert found == Expression("sub", (square, product))
    for text in ("x0 +", "x9", "open('f')", "x0 ** 4", "lambda: 0", "[x0]", "1e999", "x0\0"):
        with pytest.raises(InputError, match="fit it again"):
            parse_expression(text, names)
