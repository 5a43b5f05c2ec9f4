"""The notation of formulas: text to tree and back, with the line and column of what is wrong.

The grammar, in printable ASCII characters and line feeds:

    formula  = term { ("+" | "-") term }
    term     = factor { ("*" | "/") factor }
    factor   = { "+" | "-" } power
    power    = atom [ "**2" | "**3" ]
    atom     = number | name | function "(" formula ")" | "(" formula ")"
    number   = ( digits [ "." [ digits ] ] | "." digits ) [ ("e" | "E") [ "+" | "-" ] digits ]
    name     = word [ "." word ]
    function = "sin" | "cos" | "tanh" | "exp" | "log" | "sqrt" | "abs"
    word     = ( letter | "_" ) { letter | digit | "_" }

Operators of equal rank are applied from left to right. Whole parts of numbers do not begin with
needless zeros, no number is greater than 10^30, and brackets are at most 100 deep. Spaces may stand
between all of these. Python's parser reads it, which agrees on all that the grammar allows; what
else it would read is refused, and nothing is ever evaluated. The checker of certificates reads the
same grammar by code of its own.
"""

import ast
import math
import re
import textwrap
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.expression import (
    BINARY,
    LARGEST,
    MAX_DEPTH,
    UNARY,
    Expression,
    canonical,
    constant,
    refuse_unfit,
    variable,
)

LINE_LENGTH = 100
"""Characters of a line."""

GLUE = "\N{NO-BREAK SPACE}"
"""Stands for a space at which no line ends."""

MOST_NAMED = 16
"""Names that a refusal lists."""

_COMMENT = re.compile("#[^\n]*")

_TOKEN = re.compile(
    r" *((?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z0-9_.])"
    r"|[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)?(?![.])"
    r"|\*\* *[23](?![A-Za-z0-9_.])|\*(?!\*)|/(?!/)|[-+()])"
)

_UNPRINTABLE = re.compile(r"[^\n -~]")

SIGNS = (" + ", " - ")
"""What stands between terms."""

_OPERATORS = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div"}
_POWERS = {2: "square", 3: "cube"}
_EXPONENTS = {function: power for power, function in _POWERS.items()}
_FUNCTIONS = frozenset(UNARY) - {*_EXPONENTS, "neg"}
_SUM, _PRODUCT, _SIGN, _POWER = range(4)
_BINDING = {"add": _SUM, "sub": _SUM, "mul": _PRODUCT, "div": _PRODUCT, "neg": _SIGN}


class TextError(InputError):
    """What is wrong with a text, and where.

    Attributes:
        line: Line, counted from 1.
        column: Column, counted from 1.
    """

    def __init__(self, message: str, line: int, column: int) -> None:
        super().__init__(message)
        self.line, self.column = line, column


def parse_formula(text: str, symbols: Sequence[str]) -> Expression:
    """Reads a formula.

    Args:
        text: The formula, on one line or several, with comments after #.
        symbols: Names of the variables, in order.

    Returns:
        The formula, in canonical form.

    Raises:
        TextError: if the text is anything else; line and column are counted within it.
    """
    # On one line, whose columns are the text's characters, a formula needs no brackets of its own.
    flat = _COMMENT.sub(_blank, text).replace("\n", " ")
    start = len(flat) - len(flat.lstrip(" "))
    try:
        refuse_unprintable(flat, "a formula")
        formula = _read(flat.strip(" "), symbols)
    except TextError as error:
        before = text[: start + error.column - 1]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        raise TextError(str(error), line, column) from error
    return formula


def variable_names(count: int) -> tuple[str, ...]:
    """Names the variables as engines of symbolic regression know them: x0, x1, …"""
    return tuple(f"x{i}" for i in range(count))


def parse_expression(text: str, names: Sequence[str]) -> Expression:
    """Reads a formula as engines of symbolic regression write it.

    Powers may be x ^ 2 as well, and every name in `UNARY` is a function.

    Returns:
        The tree as it stands, which need not be in canonical form.

    Raises:
        InputError: if the text is anything else.
    """
    try:
        tree = ast.parse(text.strip().replace("^", "**"), mode="eval")
        formula = _expression(tree.body, {name: i for i, name in enumerate(names)}, UNARY)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"formula {shown(text)} cannot be read; fit it again") from error
    refuse_unfit(formula, len(names))
    return formula


def _read(code: str, symbols: Sequence[str]) -> Expression:
    """Reads a formula on one line."""
    try:
        tree = ast.parse(code, mode="eval")
        formula = _expression(tree.body, {name: i for i, name in enumerate(symbols)}, _FUNCTIONS)
        refuse_unfit(formula, len(symbols))
        _refuse_other_tokens(code)
        formula = canonical(formula)
        # A sign that has moved may stand one deeper.
        refuse_unfit(formula, len(symbols))
    except SyntaxError as error:
        raise _syntax_error(code, error) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise TextError("this cannot be read; write a simpler formula", 1, 1) from error
    except TextError:
        raise
    except InputError as error:
        raise TextError(str(error), 1, 1) from error
    return formula


def _blank(match: re.Match[str]) -> str:
    return " " * len(match[0])


def refuse_unprintable(text: str, whole: str) -> None:
    """Refuses all characters but printable ASCII ones and line feeds.

    What a person cannot see, or takes for another character, must not change what a robot does.

    Args:
        text: The text.
        whole: What the text is, in words.

    Raises:
        TextError: with line and column of the first that does not belong.
    """
    found = _UNPRINTABLE.search(text)
    if found:
        before = text[: found.start()]
        raise TextError(
            f"{shown(found[0])} does not belong in {whole}; write printable ASCII characters, and "
            "end lines by a line feed alone",
            before.count("\n") + 1,
            len(before) - before.rfind("\n"),
        )


def _refuse_other_tokens(code: str) -> None:
    """Refuses what Python reads and the grammar does not know, such as 0x10, 1_000 or (sin)(t)."""
    end, before, depth = 0, "", 0
    while end < len(code):
        token = _TOKEN.match(code, end)
        place = end + len(code[end:]) - len(code[end:].lstrip(" "))
        if token is None or (before == ")" and token[1] == "("):
            raise TextError(f"{shown(code[place])} does not belong here", 1, place + 1)
        end, before = token.end(), token[1]
        depth += (before == "(") - (before == ")")
        if depth > MAX_DEPTH:
            raise TextError(f"brackets are more than {MAX_DEPTH} deep", 1, place + 1)


def written_number(value: float) -> str:
    """Writes a number in as few digits as distinguish it from all others."""
    short = f"{value:.6g}"
    return short if float(short) == value else repr(float(value))


@dataclass(frozen=True)
class Notation:
    """How a language writes formulas.

    Attributes:
        number: Writes a number.
        function: Names a function.
        has_powers: Whether x**2 is a square and x**3 a cube; else both are functions.
    """

    number: Callable[[float], str] = written_number
    function: Callable[[str], str] = str
    has_powers: bool = True


OWN_NOTATION = Notation()
"""The notation that is read here."""


def write_formula(formula: Expression, symbols: Sequence[str]) -> str:
    """Writes a formula in canonical form so that it reads back as the same tree.

    Args:
        formula: The formula.
        symbols: Names of the variables, in order.
    """
    return "".join(formula_tokens(formula, symbols))


def formula_tokens(
    formula: Expression, symbols: Sequence[str], notation: Notation = OWN_NOTATION
) -> list[str]:
    """Writes a formula in canonical form as tokens, whose join is its text."""
    return _Writer(symbols, notation).tokens(formula)


def written_lines(
    start: str,
    formula: Expression,
    symbols: Sequence[str],
    notation: Notation = OWN_NOTATION,
    *,
    width: int = LINE_LENGTH,
    indent: int = 0,
) -> list[str]:
    """Writes a formula in lines that end before a sign between terms, and nowhere else.

    Args:
        start: What the first line begins with, such as "FL_hip = ".
        formula: The formula, in canonical form.
        symbols: Names of the variables, in order.
        notation: How the language writes it, in the order in which a policy evaluates it.
        width: Greatest number of characters of a line, where names allow.
        indent: Spaces before the first line; the others have four more.
    """
    tokens = formula_tokens(formula, symbols, notation)
    glued = "".join(f" {token.strip()}{GLUE}" if token in SIGNS else token for token in tokens)
    lines = textwrap.wrap(
        start.replace(" ", GLUE) + glued,
        width,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + 4),
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(GLUE, " ") for line in lines]


@dataclass(frozen=True)
class _Writer:
    symbols: Sequence[str]
    notation: Notation

    def tokens(self, formula: Expression) -> list[str]:
        tokens: list[str] = []
        self._write(formula, tokens)
        return tokens

    def _write(self, formula: Expression, tokens: list[str]) -> None:
        # Generators within generators would hand each token on through all that is around it.
        binding = self._binding(formula)
        match formula:
            case Expression("constant", value=value):
                tokens.append(self.notation.number(value))
            case Expression("variable", variable=index):
                tokens.append(self.symbols[index])
            case Expression("neg", (inner,)):
                tokens.append("-")
                self._write_bracketed(inner, tokens, least=_POWER)
            case Expression(operator, (left, right)):
                self._write_bracketed(left, tokens, least=binding)
                tokens.append(f" {BINARY[operator]} " if binding == _SUM else BINARY[operator])
                self._write_bracketed(right, tokens, least=binding + 1)
            case Expression(operator, (inner,)) if binding == _POWER:
                self._write_bracketed(inner, tokens, least=_POWER + 1)
                tokens.append(f"**{_EXPONENTS[operator]}")
            case Expression(operator, (inner,)):
                tokens.append(f"{self.notation.function(operator)}(")
                self._write(inner, tokens)
                tokens.append(")")

    def _write_bracketed(self, formula: Expression, tokens: list[str], *, least: int) -> None:
        """Writes an operand, in brackets where it binds less than its operator asks for."""
        if self._binding(formula) >= least:
            self._write(formula, tokens)
            return
        tokens.append("(")
        self._write(formula, tokens)
        tokens.append(")")

    def _binding(self, formula: Expression) -> int:
        if formula.operator == "constant" and formula.value < 0.0:
            return _SIGN
        if formula.operator in _EXPONENTS and self.notation.has_powers:
            return _POWER
        return _BINDING.get(formula.operator, _POWER + 1)


def _expression(node: ast.expr, index: Mapping[str, int], functions: Collection[str]) -> Expression:
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float() as value):
            return constant(_number(value, node))
        case ast.Name() | ast.Attribute():
            return _named(node, index)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _expression(operand, index, functions)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _expression(operand, index, functions)
            if inner.operator == "constant":
                return constant(-inner.value)
            return Expression("neg", (inner,))
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as power)) if (
            power in _POWERS
        ):
            return Expression(_POWERS[power], (_expression(left, index, functions),))
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
            operands = tuple(_expression(own, index, functions) for own in (left, right))
            return Expression(_OPERATORS[type(operator)], operands)
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if (
            function in functions
        ):
            return Expression(function, (_expression(argument, index, functions),))
    raise _at(node, f"{shown(ast.unparse(node))} does not belong in a formula")


def _number(value: float, node: ast.expr) -> float:
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not abs(number) <= LARGEST:
        raise _at(node, f"a number must be from {-LARGEST:g} to {LARGEST:g}")
    return number


def _named(node: ast.expr, index: Mapping[str, int]) -> Expression:
    name = ast.unparse(node)
    if name not in index:
        raise _at(node, f"nothing is called {shown(name)}; {_known(name, index)}")
    return variable(index[name])


def _known(name: str, names: Iterable[str]) -> str:
    """Names what begins as the unknown name does, or the beginnings that there are."""
    start = name.partition(".")[0]
    alike = [known for known in names if known.partition(".")[0] == start]
    if alike:
        return f"there are {_listed(alike)}"
    kinds = dict.fromkeys(
        f"{known.partition('.')[0]}.…" if "." in known else known for known in names
    )
    return f"there are {_listed(list(kinds))}"


def _listed(names: Sequence[str]) -> str:
    more = ["…"] if len(names) > MOST_NAMED else []
    return ", ".join([*names[:MOST_NAMED], *more])


def _at(node: ast.expr, message: str) -> TextError:
    return TextError(message, 1, node.col_offset + 1)


def _syntax_error(code: str, error: SyntaxError) -> TextError:
    """Describes what Python's parser found, without what is Python's alone."""
    # Of what is missing at the end, Python gives no place.
    message, column = error.msg, min(error.offset or len(code) + 1, len(code) + 1)
    if not code:
        return TextError("there is no formula", 1, 1)
    if "never closed" in message:
        return TextError("this bracket is never closed", 1, column)
    if "unmatched" in message or "does not match" in message:
        return TextError("this bracket was never opened", 1, column)
    if column > len(code):
        return TextError("the formula ends before it is complete", 1, len(code) + 1)
    return TextError("this does not belong in a formula", 1, column)
