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
from collections.abc import Iterable, Iterator, Mapping, Sequence

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.canonical import canonical
from glassgait.models.formulas.expression import BINARY, UNARY, Expression, constant, variable
from glassgait.models.formulas.expression_text import LARGEST, MAX_DEPTH, refuse_unfit

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
_SUM, _PRODUCT, _SIGN, _POWER = range(4)
_BINDING = {"add": _SUM, "sub": _SUM, "mul": _PRODUCT, "div": _PRODUCT, "neg": _SIGN}
_BINDING |= dict.fromkeys(_EXPONENTS, _POWER)


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


def _read(code: str, symbols: Sequence[str]) -> Expression:
    """Reads a formula on one line."""
    try:
        tree = ast.parse(code, mode="eval")
        formula = _expression(tree.body, {name: i for i, name in enumerate(symbols)})
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


def write_formula(formula: Expression, symbols: Sequence[str]) -> str:
    """Writes a formula in canonical form so that it reads back as the same tree.

    Args:
        formula: The formula.
        symbols: Names of the variables, in order.
    """
    return "".join(_tokens(formula, symbols))


def written_lines(title: str, formula: Expression, symbols: Sequence[str]) -> list[str]:
    """Writes `title = formula` in lines of at most `LINE_LENGTH` characters, where names allow.

    Args:
        title: What the formula is of.
        formula: The formula, in canonical form.
        symbols: Names of the variables, in order.
    """
    # A line ends before a sign between terms, and nowhere else.
    tokens = _tokens(formula, symbols)
    glued = "".join(f" {token.strip()}{GLUE}" if token in SIGNS else token for token in tokens)
    lines = textwrap.wrap(
        f"{title}{GLUE}={GLUE}{glued}",
        LINE_LENGTH,
        subsequent_indent="    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(GLUE, " ") for line in lines]


def written_number(value: float) -> str:
    """Writes a number in as few digits as tell it from all others."""
    short = f"{value:.6g}"
    return short if float(short) == value else repr(float(value))


def _tokens(formula: Expression, symbols: Sequence[str]) -> Iterator[str]:
    binding = _binding(formula)
    match formula:
        case Expression("constant", value=value):
            yield written_number(value)
        case Expression("variable", variable=index):
            yield symbols[index]
        case Expression("neg", (inner,)):
            yield "-"
            yield from _bracketed(inner, symbols, least=_POWER)
        case Expression(operator, (left, right)):
            yield from _bracketed(left, symbols, least=binding)
            yield f" {BINARY[operator]} " if binding == _SUM else BINARY[operator]
            yield from _bracketed(right, symbols, least=binding + 1)
        case Expression(operator, (inner,)) if operator in _EXPONENTS:
            yield from _bracketed(inner, symbols, least=_POWER + 1)
            yield f"**{_EXPONENTS[operator]}"
        case Expression(operator, (inner,)):
            yield f"{operator}("
            yield from _tokens(inner, symbols)
            yield ")"


def _bracketed(formula: Expression, symbols: Sequence[str], *, least: int) -> Iterator[str]:
    """Writes an operand, in brackets where it binds less than its operator asks for."""
    if _binding(formula) >= least:
        yield from _tokens(formula, symbols)
        return
    yield "("
    yield from _tokens(formula, symbols)
    yield ")"


def _binding(formula: Expression) -> int:
    if formula.operator == "constant" and formula.value < 0.0:
        return _SIGN
    return _BINDING.get(formula.operator, _POWER + 1)


def _expression(node: ast.expr, index: Mapping[str, int]) -> Expression:
    match node:
        case ast.Constant(value=bool()):
            pass
        case ast.Constant(value=int() | float() as value):
            return constant(_number(value, node))
        case ast.Name() | ast.Attribute():
            return _named(node, index)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            return _expression(operand, index)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _expression(operand, index)
            if inner.operator == "constant":
                return constant(-inner.value)
            return Expression("neg", (inner,))
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as power)) if (
            power in _POWERS
        ):
            return Expression(_POWERS[power], (_expression(left, index),))
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
            operands = (_expression(left, index), _expression(right, index))
            return Expression(_OPERATORS[type(operator)], operands)
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if (
            function in UNARY and function not in (*_EXPONENTS, "neg")
        ):
            return Expression(function, (_expression(argument, index),))
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
    """Tells what Python's parser found, without what is Python's alone."""
    # Of what is missing at the end, Python tells no place.
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
