"""Formulas for people: named observations with units, three digits, as Markdown and LaTeX."""

from collections.abc import Sequence
from pathlib import Path

import sympy

from models.a1 import robot
from models.files import write_atomically
from models.policies.expression import Expression
from models.policies.symbolic import FormulaPolicy
from models.task.observation import unit_of

DIGITS = 3

TERMS_PER_LINE = 4
"""Terms of a formula in a line of LaTeX."""

_LATEX = {
    "Command X": "v_x^{*}",
    "Command Yaw": r"\omega_z^{*}",
    "RM Iters": "n",
    "Command RM Iters": "n^{*}",
}

_LATEX_PREFIXES = {
    "DoF Pos": r"q_{\mathrm{%s}}",
    "DoF Vel": r"\dot q_{\mathrm{%s}}",
    "Prev Action": r"a^{-}_{\mathrm{%s}}",
    "RM State": "s_{%s}",
    "Base Lin Vel": r"\hat v_{%s}",
    "Foot Height": r"\hat h_{\mathrm{%s}}",
}


def readable_formula(formula: Expression, names: tuple[str, ...]) -> str:
    """Writes a formula as text, its terms from the heaviest constant down.

    Args:
        formula: The formula.
        names: Names of the observations.
    """
    text = ""
    for minus, term in _signed_terms(formula, names):
        text += (" − " if minus else " + ") if text else ("−" if minus else "")
        text += str(term)
    return text


def latex_formula(formula: Expression, names: tuple[str, ...]) -> str:
    """Writes a formula as the right side of LaTeX's `align*`, a few terms a line.

    Args:
        formula: The formula.
        names: Names of the observations.
    """
    symbols = {sympy.Symbol(name): latex_symbol(name) for name in names}
    lines: list[str] = []
    for position, (minus, term) in enumerate(_signed_terms(formula, names)):
        body = sympy.latex(term, symbol_names=symbols, mul_symbol="dot")
        sign = "-" if minus else "+" if position else ""
        if position % TERMS_PER_LINE == 0:
            lines.append("")
        lines[-1] += f" {sign} {body}"
    return " \\\\\n  &".join(line.strip() for line in lines)


def latex_symbol(name: str) -> str:
    """Returns the symbol that an observation has in LaTeX."""
    if name in _LATEX:
        return _LATEX[name]
    prefix = next(prefix for prefix in _LATEX_PREFIXES if name.startswith(prefix))
    rest = name.removeprefix(prefix).strip()
    return _LATEX_PREFIXES[prefix] % (rest.lower() if prefix == "Base Lin Vel" else rest)


def write_formulas(policy: FormulaPolicy, stem: Path) -> None:
    """Writes a policy's formulas as `<stem>.md` and `<stem>.tex`."""
    write_atomically(stem.with_name(f"{stem.name}.md"), _markdown(policy))
    write_atomically(stem.with_name(f"{stem.name}.tex"), _latex(policy))


def _markdown(policy: FormulaPolicy) -> str:
    names = policy.observation_names
    lines = [
        f"# {policy.gait}: {policy.kind.replace('_', ' ')} policy",
        "",
        f"Each action is a formula; a joint's target is its default plus {robot.ACTION_SCALE} rad "
        "times the action. Constants are rounded to three digits here.",
        "",
    ]
    for title, formulas in _sections(policy):
        lines += [f"## {title}", ""] if title else []
        for joint, formula in zip(robot.JOINTS, formulas, strict=True):
            lines += [f"**{joint}** = {readable_formula(formula, names)}", ""]
    lines += ["## Observations", "", "| name | in LaTeX | unit |", "|---|---|---|"]
    lines += [f"| {name} | ${latex_symbol(name)}$ | {unit_of(name)} |" for name in names]
    return "\n".join(lines) + "\n"


def _latex(policy: FormulaPolicy) -> str:
    text = "% Needs amsmath. Observations and their units: see the Markdown page beside this one.\n"
    for title, formulas in _sections(policy):
        text += f"\\paragraph{{{title}}}\n" if title else ""
        for joint, formula in zip(robot.JOINTS, formulas, strict=True):
            name = joint.replace("_", r"\,")
            right = latex_formula(formula, policy.observation_names)
            text += (
                f"\\begin{{align*}}\n  a_{{\\mathrm{{{name}}}}} ={{}}&{right}\n\\end{{align*}}\n"
            )
    return text


def _sections(policy: FormulaPolicy) -> list[tuple[str, Sequence[Expression]]]:
    every = policy.formulas_by_state
    return [
        (f"RM state {i}" if len(every) > 1 else "", formulas) for i, formulas in enumerate(every)
    ]


def _signed_terms(formula: Expression, names: tuple[str, ...]) -> list[tuple[bool, sympy.Expr]]:
    """Splits a formula into terms, heaviest first, each with whether it is subtracted."""
    symbols = tuple(sympy.Symbol(name) for name in names)
    terms = sympy.Add.make_args(_rounded(formula.to_sympy(symbols)))
    ordered = sorted(terms, key=lambda term: -abs(_weight(term)))
    signs = [bool(term.could_extract_minus_sign()) for term in ordered]
    return [(minus, -term if minus else term) for minus, term in zip(signs, ordered, strict=True)]


def _rounded(expression: sympy.Expr) -> sympy.Expr:
    floats = {number: sympy.Float(number, DIGITS) for number in expression.atoms(sympy.Float)}
    return expression.xreplace(floats)


def _weight(term: sympy.Expr) -> float:
    coefficient, rest = term.as_coeff_Mul()
    return float(coefficient) if rest != 1 else 0.0
