"""Formulas for papers: LaTeX of the tree that acts."""

from collections.abc import Sequence
from pathlib import Path

from glassgait.models.files import write_atomically
from glassgait.models.formulas.expression import Expression, is_negative, negative
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.formulas.text import written_number
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of

TERMS_PER_LINE = 4
"""Terms of a formula in a line."""

_DEFINED = {"late": r"\ell", "phase": r"\varphi", "e.v": "e_v"}
_OF_LEGS = {"lifted": "u", "x": "x", "z": "z"}
_POWERS = {"square": 2, "cube": 3}
_FUNCTIONS = {"abs": r"\operatorname{abs}", "sqrt": r"\operatorname{sqrt}"}


def write_latex(policy: FormulaPolicy, path: Path) -> None:
    """Writes all that the policy's file holds as LaTeX, atomically."""
    file, symbols = policy.to_file(), latex_symbols(policy.vocabulary)
    text = f"% {policy.gait}: joint targets in rad. Needs amsmath.\n"
    for definition in policy.vocabulary.definitions:
        symbol = symbols[policy.vocabulary.symbols.index(definition.symbol)]
        text += _aligned(symbol, definition.formula, symbols)
    section = None
    for (*state, joint), formula in file.written().items():
        title = f"RM state {state[0]}" if state else None
        if title != section:
            text += f"\\paragraph{{{title}}}\n"
            section = title
        name = quadruped.JOINTS[joint].replace("_", r"\,")
        text += _aligned(rf"q^{{*}}_{{\mathrm{{{name}}}}}", formula, symbols)
    write_atomically(path, text)


def latex_symbols(vocabulary: Vocabulary) -> tuple[str, ...]:
    """Returns the symbol of each variable, in order."""
    observed = (entry.latex for entry in entries_of(vocabulary.names))
    return (*observed, *(_defined(definition.symbol) for definition in vocabulary.definitions))


def latex_formula(formula: Expression, symbols: Sequence[str]) -> str:
    """Writes a formula in canonical form as the right side of `align*`, a few terms a line.

    Args:
        symbols: Symbols of the variables, in order.
    """
    pieces = _terms(formula, symbols)
    lines = [pieces[i : i + TERMS_PER_LINE] for i in range(0, len(pieces), TERMS_PER_LINE)]
    return " \\\\\n  &".join(" ".join(line) for line in lines)


def _aligned(left: str, right: Expression, symbols: Sequence[str]) -> str:
    return f"\\begin{{align*}}\n  {left} ={{}}&{latex_formula(right, symbols)}\n\\end{{align*}}\n"


def _defined(symbol: str) -> str:
    kind, _, leg = symbol.partition(".")
    if leg in quadruped.LEGS and kind in _OF_LEGS:
        return rf"{_OF_LEGS[kind]}_{{\mathrm{{{leg}}}}}"
    return _DEFINED.get(symbol) or rf"\mathrm{{{symbol}}}".replace("_", r"\_")


def _terms(formula: Expression, symbols: Sequence[str]) -> list[str]:
    """Writes the terms of a sum, each but the first with its sign."""
    match formula:
        case Expression("add", (left, right)):
            return [*_terms(left, symbols), f"+ {_factor(right, symbols)}"]
        case Expression("sub", (left, right)):
            return [*_terms(left, symbols), f"- {_factor(right, symbols)}"]
        case _:
            return [_product(formula, symbols)]


def _product(formula: Expression, symbols: Sequence[str]) -> str:
    match formula:
        case Expression("mul", (left, right)):
            # A dot for numbers and brackets; symbols stand side by side.
            sign = r" \cdot " if right.operator == "constant" else r" \, "
            return f"{_factor(left, symbols, led=True)}{sign}{_factor(right, symbols)}"
        case Expression("div", (left, right)):
            if is_negative(left):
                return f"-{_product(Expression('div', (negative(left), right)), symbols)}"
            return rf"\frac{{{_whole(left, symbols)}}}{{{_whole(right, symbols)}}}"
        case Expression("add" | "sub"):
            return f"({_whole(formula, symbols)})"
        case _:
            return _atom(formula, symbols)


def _atom(formula: Expression, symbols: Sequence[str]) -> str:
    match formula:
        case Expression("constant", value=value):
            mantissa, _, exponent = written_number(value).partition("e")
            return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa
        case Expression("variable", variable=index):
            return symbols[index]
        case Expression("neg", (inner,)):
            return f"-{_factor(inner, symbols)}"
        case Expression(("square" | "cube") as operator, (inner,)):
            return rf"\left({_whole(inner, symbols)}\right)^{_POWERS[operator]}"
        case Expression(operator, (inner,)):
            name = _FUNCTIONS.get(operator, f"\\{operator}")
            return rf"{name}\left({_whole(inner, symbols)}\right)"
    raise AssertionError(formula.operator)


def _factor(formula: Expression, symbols: Sequence[str], *, led: bool = False) -> str:
    """Writes an operand, in brackets where it is a sum or begins with a sign inside a term."""
    text = _product(formula, symbols)
    return f"({text})" if text.startswith("-") and not led else text


def _whole(formula: Expression, symbols: Sequence[str]) -> str:
    return " ".join(_terms(formula, symbols))
