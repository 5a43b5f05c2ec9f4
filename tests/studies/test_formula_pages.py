"""Formulas as people read them, in text and in LaTeX."""

from glassgait.models.policies.expression_text import parse_expression, variable_names
from glassgait.models.policies.library import load_expert
from glassgait.studies.students.formula_pages import latex_formula, readable_formula


def test_latex_takes_the_papers_symbols():
    names = load_expert("trot").observation_names
    index = {name: f"x{i}" for i, name in enumerate(names)}
    text = f"2.5 * {index['DoF Pos FL Hip']} - {index['RM Iters']} * {index['Command X']}"
    formula = parse_expression(text, variable_names(len(names)))
    expected = r"2.5 \cdot q_{\mathrm{FL Hip}} - v_x^{*} \cdot n"
    assert latex_formula(formula, names) == expected


def test_formulas_read_as_people_write_them():
    names = load_expert("trot").observation_names
    at = {name: f"x{i}" for i, name in enumerate(names)}
    x, q, state = at["Command X"], at["DoF Pos FL Hip"], at["RM State 0"]
    text = f"0.5 - 2.0 * {x} + 1.5 * {q} + {state} * (0.25 * {x} - 3.0 * square({q}))"
    formula = parse_expression(text, variable_names(len(names)))
    assert readable_formula(formula, names) == (
        "−2.0 · Command X + 1.5 · DoF Pos FL Hip + RM State 0 · "
        "(−3.0 · (DoF Pos FL Hip)^2 + 0.25 · Command X) + 0.5"
    )
    assert latex_formula(formula, names) == (
        r"-2.0 \cdot v_x^{*} + 1.5 \cdot q_{\mathrm{FL Hip}} "
        r"+ s_{0} \cdot \bigl(-3.0 \cdot q_{\mathrm{FL Hip}}^{2} + 0.25 \cdot v_x^{*}\bigr) \\"
        "\n  &+ 0.5"
    )


def test_formulas_name_their_gates_and_put_in_the_state_they_serve():
    names = load_expert("trot").observation_names
    at = {name: f"x{i}" for i, name in enumerate(names)}
    text = (
        f"(tanh((5.0 * {at['RM Iters']} + -2.0)) * (0.5 * {at['RM State 1']} + 2.0 * "
        f"{at['Command X']})) + (tanh((100.0 * {at['Foot Height RL']} + -2.0)) * "
        f"(3.0 * {at['RM State 0']}))"
    )
    formula = parse_expression(text, variable_names(len(names)))
    assert readable_formula(formula, names) == (
        "3.0 · Lifted RL · RM State 0 + Late · (2.0 · Command X + 0.5 · RM State 1)"
    )
    assert readable_formula(formula, names, state=0) == "3.0 · Lifted RL + 2.0 · Command X · Late"
    assert readable_formula(formula, names, state=1) == "Late · (2.0 · Command X + 0.5)"
    assert latex_formula(formula, names, state=0) == (
        r"3.0 \cdot u_{\mathrm{RL}} + 2.0 \cdot v_x^{*} \cdot \ell"
    )
