"""Formulas for people: named observations with units, three digits, as Markdown and LaTeX."""

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import sympy
from sympy.printing.str import StrPrinter

from glassgait.models.a1 import robot
from glassgait.models.files import write_atomically
from glassgait.models.policies.expression import Expression
from glassgait.models.policies.gates import GATE_MEANINGS, named_gates
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.observation import entry_of, indices_of
from glassgait.studies.tables import escape_markdown

DIGITS = 3

TERMS_PER_LINE = 4
"""Terms of a formula in a line of LaTeX."""

LINE_LENGTH = 100
"""Characters of a line of text."""

GLUE = "\N{NO-BREAK SPACE}"
"""Stands for a space at which no line is broken."""

MINUS = "\N{MINUS SIGN}"

_GATE_SYMBOLS = {"Late": r"\ell"} | {
    f"Lifted {leg}": rf"u_{{\mathrm{{{leg}}}}}" for leg in robot.LEGS
}


def readable_formula(formula: Expression, names: tuple[str, ...], state: int | None = None) -> str:
    """Writes a formula as text: its weighted observations from the heaviest down, then the rest.

    Args:
        formula: The formula.
        names: Names of the observations.
        state: State of the machine that the formula serves, where it serves one alone.
    """
    return " ".join(_pieces(_named(formula, names, state), _TEXT))


def latex_formula(formula: Expression, names: tuple[str, ...], state: int | None = None) -> str:
    """Writes a formula as the right side of LaTeX's `align*`, a few terms a line.

    Args:
        formula: The formula.
        names: Names of the observations.
        state: State of the machine that the formula serves, where it serves one alone.
    """
    symbols = {sympy.Symbol(name): latex_symbol(name) for name in (*names, *named_gates(names))}

    def write(term: sympy.Expr) -> str:
        return sympy.latex(term, symbol_names=symbols, mul_symbol="dot")

    style = _Style(write, "-", r" \cdot ", (r"\bigl(", r"\bigr)"))
    pieces = _pieces(_named(formula, names, state), style)
    lines = [pieces[i : i + TERMS_PER_LINE] for i in range(0, len(pieces), TERMS_PER_LINE)]
    return " \\\\\n  &".join(" ".join(line) for line in lines)


def latex_symbol(name: str) -> str:
    """Returns the symbol that an observation or a gate has in LaTeX."""
    return _GATE_SYMBOLS.get(name) or entry_of(name).latex


def write_formulas(policy: FormulaPolicy, stem: Path) -> None:
    """Writes a policy's formulas as `<stem>.md` and `<stem>.tex`."""
    write_atomically(stem.with_name(f"{stem.name}.md"), _markdown(policy))
    write_atomically(stem.with_name(f"{stem.name}.tex"), _latex(policy))


def _markdown(policy: FormulaPolicy) -> str:
    names = policy.observation_names
    lines = [
        f"# {escape_markdown(policy.gait)}: {policy.kind.replace('_', ' ')} policy",
        "",
        f"Each action is a formula; a joint's target is its default plus {robot.ACTION_SCALE} rad "
        "times the action. Constants are rounded to three digits here.",
        "",
        "Gates tell where in the gait the robot is:",
        "",
        "| gate | in LaTeX | formula | value |",
        "|---|---|---|---|",
        *_gate_rows(names),
        "",
    ]
    for title, state, formulas in _sections(policy):
        lines += [f"## {title}", ""] if title else []
        for joint, formula in zip(robot.JOINTS, formulas, strict=True):
            lines += ["```text", *_wrapped(joint, formula, names, state), "```", ""]
    lines += ["## Observations", "", "| name | in LaTeX | unit |", "|---|---|---|"]
    lines += [
        f"| {name} | ${latex_symbol(name)}$ | {entry_of(name).scaled_unit} |" for name in names
    ]
    return "\n".join(lines) + "\n"


def _gate_rows(names: tuple[str, ...]) -> list[str]:
    return [
        f"| {title} | ${latex_symbol(title)}$ | {_write_text(_rounded(gate, names))} "
        f"| {GATE_MEANINGS[title.split()[0]]} |"
        for title, gate in named_gates(names).items()
    ]


def _wrapped(
    joint: str, formula: Expression, names: tuple[str, ...], state: int | None
) -> list[str]:
    """Breaks a formula into lines between its terms."""
    glued = [piece.replace(" ", GLUE) for piece in _pieces(_named(formula, names, state), _TEXT)]
    text = f"{joint}{GLUE}={GLUE}" + " ".join(glued)
    lines = textwrap.wrap(
        text, LINE_LENGTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )
    return [line.replace(GLUE, " ") for line in lines]


def _latex(policy: FormulaPolicy) -> str:
    text = "% Needs amsmath. Observations and their units: see the Markdown page beside this one.\n"
    for title, state, formulas in _sections(policy):
        text += f"\\paragraph{{{title}}}\n" if title else ""
        for joint, formula in zip(robot.JOINTS, formulas, strict=True):
            name = joint.replace("_", r"\,")
            right = latex_formula(formula, policy.observation_names, state)
            text += (
                f"\\begin{{align*}}\n  a_{{\\mathrm{{{name}}}}} ={{}}&{right}\n\\end{{align*}}\n"
            )
    return text


def _sections(
    policy: FormulaPolicy,
) -> list[tuple[str, int | None, Sequence[Expression]]]:
    """Returns title, state of the machine and formulas of each part of a page."""
    every = policy.formulas_by_state
    if len(every) == 1:
        return [("", None, every[0])]
    return [(f"RM state {state}", state, formulas) for state, formulas in enumerate(every)]


@dataclass(frozen=True)
class _Style:
    """How pieces of a formula are written: one term, and what stands between and around terms."""

    write: Callable[[sympy.Expr], str]
    minus: str
    times: str
    brackets: tuple[str, str]


class _TextPrinter(StrPrinter):
    # Names hold spaces, so that a power without brackets could be misread.
    def _print_Pow(self, expr: sympy.Pow, rational: bool = False) -> str:  # noqa: N802
        return f"({self.doprint(expr.base)})^{self.doprint(expr.exp)}"


def _write_text(term: sympy.Expr) -> str:
    return (
        _TextPrinter({"full_prec": False})
        .doprint(term)
        .replace("*", " · ")
        .replace(" - ", f" {MINUS} ")
    )


_TEXT = _Style(_write_text, MINUS, " · ", ("(", ")"))


def _pieces(expression: sympy.Expr, style: _Style) -> list[str]:
    """Writes a sum as a list of signed terms; the terms of a product with a sum are terms too."""
    terms = sorted(sympy.Add.make_args(expression), key=_order)
    pieces: list[str] = []
    for term in terms:
        minus = term.could_extract_minus_sign()
        own = _product_pieces(-term if minus else term, style)
        sign = style.minus if minus else "+"
        if pieces:
            own[0] = f"{sign} {own[0]}"
        elif minus:
            own[0] = sign + own[0]
        pieces += own
    return pieces


def _product_pieces(term: sympy.Expr, style: _Style) -> list[str]:
    sums = [factor for factor in sympy.Mul.make_args(term) if isinstance(factor, sympy.Add)]
    if len(sums) != 1:
        return [style.write(term)]
    opening, closing = style.brackets
    inner = _pieces(sums[0], style)
    inner[0] = style.write(term / sums[0]) + style.times + opening + inner[0]
    inner[-1] += closing
    return inner


def _order(term: sympy.Expr) -> tuple[bool, bool, float]:
    """Orders weighted observations by weight, then products with sums, then the constant."""
    coefficient, rest = term.as_coeff_Mul()
    return rest == 1, rest.has(sympy.Add), -abs(float(coefficient))


def _named(formula: Expression, names: tuple[str, ...], state: int | None) -> sympy.Expr:
    """Names the gates of a formula, and puts in what is known in a state of the machine."""
    known = {}
    if state is not None:
        one_hot = [names[index] for index in indices_of("machine state", names)]
        known = {sympy.Symbol(name): sympy.Integer(i == state) for i, name in enumerate(one_hot)}
    return _rounded(formula, names).xreplace(_gate_symbols(names)).xreplace(known)


@cache
def _gate_symbols(names: tuple[str, ...]) -> dict[sympy.Expr, sympy.Symbol]:
    """Returns the symbol of each gate, by the gate as pages write it."""
    return {
        _rounded(gate, names): sympy.Symbol(title) for title, gate in named_gates(names).items()
    }


def _rounded(formula: Expression, names: tuple[str, ...]) -> sympy.Expr:
    expression: Any = formula.to_sympy(tuple(sympy.Symbol(name) for name in names))
    floats = {number: sympy.Float(number, DIGITS) for number in expression.atoms(sympy.Float)}
    return expression.xreplace(floats)
