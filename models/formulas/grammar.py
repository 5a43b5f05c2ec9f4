"""Parses and writes formulas, and reports errors with line and column.

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

Operators of equal precedence apply from left to right. Numbers have no needless leading zeros and
are at most 10^30; brackets are at most 100 deep. Spaces may separate tokens. The checker of
certificates reads the same grammar with separate code.
"""

import re
import textwrap
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Self

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.expression import (
    BINARY,
    LARGEST,
    MAX_DEPTH,
    UNARY,
    Expression,
    checked_formula,
    constant,
    negated,
    refuse_unfit,
    variable,
)

LINE_LENGTH = 100

GLUE = "\N{NO-BREAK SPACE}"  # replaces a space at which no line may end

_COMMENT = re.compile("#[^\n]*")

_DIGITS = r"(?:0|[1-9][0-9]*)"
_WORD = r"[A-Za-z_][A-Za-z0-9_]*"
_TOKEN = re.compile(
    rf" *(?:(?P<number>(?:{_DIGITS}(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)(?![A-Za-z0-9_.])"
    rf"|(?P<name>{_WORD}(?:\.{_WORD})?)(?!\.)"
    r"|(?P<power>\*\* *[23])(?![A-Za-z0-9_.])"
    r"|(?P<sign>\*(?!\*)|/(?!/)|[-+()]))"
)

_UNPRINTABLE = re.compile(r"[^\n -~]")

SIGNS = (" + ", " - ")  # signs between terms, as they are written

_OPERATORS = {sign: operator for operator, sign in BINARY.items()}
_EXPONENTS = {"square": 2, "cube": 3}
_FUNCTIONS = frozenset(UNARY) - {*_EXPONENTS, "neg"}
_SUM, _PRODUCT, _SIGN, _POWER = range(4)
_BINDING = {"add": _SUM, "sub": _SUM, "mul": _PRODUCT, "div": _PRODUCT, "neg": _SIGN}


class TextError(InputError):
    """An error in a text, with its line and column, counted from 1."""

    def __init__(self, message: str, line: int, column: int) -> None:
        super().__init__(message)
        self.line, self.column = line, column

    @classmethod
    def at(cls, message: str, text: str, index: int) -> Self:
        """Returns the error at an index of a text."""
        before = text[:index]
        return cls(message, before.count("\n") + 1, len(before) - before.rfind("\n"))


def parse_formula(text: str, symbols: Sequence[str]) -> Expression:
    """Reads a formula, with comments after #, into canonical form; raises a `TextError`."""
    # Replace comments and line feeds by spaces, so that every character keeps its index.
    flat = _COMMENT.sub(lambda comment: " " * len(comment[0]), text).replace("\n", " ")
    try:
        refuse_unprintable(flat, "a formula")
        formula = _Parser(flat.rstrip(" "), symbols, _FUNCTIONS).read()
        return checked_formula(formula, len(symbols))
    except TextError as error:
        raise TextError.at(str(error), text, error.column - 1) from error
    except InputError as error:
        raise TextError(str(error), 1, 1) from error


def variable_names(count: int) -> tuple[str, ...]:
    """Returns the names that symbolic regression engines give to variables: x0, x1, ..."""
    return tuple(f"x{i}" for i in range(count))


def parse_expression(text: str, names: Sequence[str]) -> Expression:
    """Reads a formula of a symbolic regression engine; its tree may not be canonical.

    Powers may also be written x ^ 2, and every name in `UNARY` is a function.
    """
    try:
        formula = _Parser(text.replace("^", "**"), names, UNARY).read()
    except TextError as error:
        raise InputError(f"formula {shown(text)} cannot be read; fit it again") from error
    refuse_unfit(formula, len(names))
    return formula


def refuse_unprintable(text: str, whole: str) -> None:
    """Refuses characters other than printable ASCII and line feeds.

    Invisible and look-alike characters must not change what a robot does.
    """
    if character := _UNPRINTABLE.search(text):
        problem = f"{shown(character[0])} does not belong in {whole}; write printable ASCII"
        raise TextError.at(problem, text, character.start())


class _Parser:
    """Reads a formula on one line by recursive descent."""

    def __init__(self, code: str, symbols: Sequence[str], functions: Collection[str]) -> None:
        self.index = {name: i for i, name in enumerate(symbols)}
        self.functions, self.depth, self.at = functions, 0, 0
        # Split the code into tokens: kind, text and place of each.
        self.tokens: list[tuple[str, str, int]] = []
        end = 0
        while end < len(code.rstrip(" ")):
            token = _TOKEN.match(code, end)
            if token is None:
                place = end + len(code[end:]) - len(code[end:].lstrip(" "))
                word = re.findall(r"(?s)[\w.]+|.", code[place:])[0]
                problem = "is not a number" if word[0].isdigit() else "does not belong here"
                raise TextError(f"{shown(word)} {problem}", 1, place + 1)
            kind, end = str(token.lastgroup), token.end()
            self.tokens.append((kind, token[kind], token.start(kind)))
        self.tokens.append(("end", "", len(code)))

    def read(self) -> Expression:
        if len(self.tokens) == 1:
            raise TextError("there is no formula", 1, 1)
        formula = self._sum()
        if self.tokens[self.at][0] != "end":
            raise self._misplaced()
        return formula

    def _take(self, *expected: str) -> str:
        """Consumes the next token if it is one of the expected ones, else returns ""."""
        text = self.tokens[self.at][1]
        if text not in expected:
            return ""
        self.at += 1
        return text

    def _sum(self) -> Expression:
        formula = self._product()
        while sign := self._take("+", "-"):
            formula = Expression(_OPERATORS[sign], (formula, self._product()))
        return formula

    def _product(self) -> Expression:
        formula = self._factor()
        while sign := self._take("*", "/"):
            formula = Expression(_OPERATORS[sign], (formula, self._factor()))
        return formula

    def _factor(self) -> Expression:
        # A power binds more tightly than the signs before it.
        minus = 0
        while sign := self._take("+", "-"):
            minus += sign == "-"
        formula = self._atom()
        kind, text, _ = self.tokens[self.at]
        if kind == "power":
            self.at += 1
            formula = Expression("square" if text[-1] == "2" else "cube", (formula,))
        for _ in range(minus):
            formula = negated(formula)
        return formula

    def _atom(self) -> Expression:
        kind, text, place = self.tokens[self.at]
        is_call = kind == "name" and self.tokens[self.at + 1][1] == "("
        if kind == "number":
            if not float(text) <= LARGEST:
                raise TextError(f"a number must be from {-LARGEST:g} to {LARGEST:g}", 1, place + 1)
            self.at += 1
            return constant(float(text))
        # A name without a bracket after it is a variable.
        if kind == "name" and not is_call:
            if text not in self.index:
                known = _known(text, self.index)
                raise TextError(f"unknown name {shown(text)}; {known}", 1, place + 1)
            self.at += 1
            return variable(self.index[text])
        # A bracket, or a function and its bracket, remains.
        if is_call and text in self.functions:
            self.at += 1
        if not self._take("("):
            raise self._misplaced()
        formula = self._in_brackets()
        return Expression(text, (formula,)) if is_call else formula

    def _in_brackets(self) -> Expression:
        """Reads a formula after an opening bracket, and the closing bracket."""
        place = self.tokens[self.at - 1][2]
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise TextError(f"brackets are more than {MAX_DEPTH} deep", 1, place + 1)
        formula = self._sum()
        if self.tokens[self.at][0] == "end":
            raise TextError("this bracket is never closed", 1, place + 1)
        if not self._take(")"):
            raise self._misplaced()
        self.depth -= 1
        return formula

    def _misplaced(self) -> TextError:
        kind, text, place = self.tokens[self.at]
        if kind == "end":
            message = "the formula ends before it is complete"
        elif text == ")" and not self.depth:
            message = "this bracket was never opened"
        else:
            message = f"{shown(text)} does not belong here"
        return TextError(message, 1, place + 1)


def _known(name: str, names: Iterable[str]) -> str:
    """Lists the names that share the first part of an unknown name, or else all first parts."""
    start = name.partition(".")[0]
    alike = [known for known in names if known.partition(".")[0] == start]
    if not alike:
        alike = [f"{known.partition('.')[0]}.…" if "." in known else known for known in names]
    listed = [*dict.fromkeys(alike)]
    # Keep the message short.
    more = ["…"] if len(listed) > 16 else []
    return f"there are {', '.join([*listed[:16], *more])}"


def written_number(value: float) -> str:
    """Writes a number with the fewest digits that distinguish it from all others."""
    short = f"{value:.6g}"
    return short if float(short) == value else repr(float(value))


@dataclass(frozen=True)
class Notation:
    """The notation of a language; without powers, squares and cubes are functions."""

    number: Callable[[float], str] = written_number
    function: Callable[[str], str] = str
    has_powers: bool = True


FILE_NOTATION = Notation()


def write_formula(formula: Expression, symbols: Sequence[str]) -> str:
    """Writes a formula in canonical form so that it reads back as the same tree."""
    return "".join(formula_tokens(formula, symbols))


def written_lines(
    start: str,
    formula: Expression,
    symbols: Sequence[str],
    notation: Notation = FILE_NOTATION,
    *,
    width: int = LINE_LENGTH,
    indent: int = 0,
) -> list[str]:
    """Writes a formula on lines that end only before a sign between terms.

    Lines have at most `width` characters if names allow it. The first one begins with `indent`
    spaces and `start`; the others are indented by four more.
    """
    # Glue all spaces except those before signs.
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


def formula_tokens(
    formula: Expression, symbols: Sequence[str], notation: Notation = FILE_NOTATION
) -> Iterator[str]:
    """Yields the tokens of a formula in canonical form; joined, they are its text."""
    binding = _binding(formula, notation)

    def operand(inner: Expression, least: int) -> Iterable[str]:
        """Writes an operand, in brackets if it binds less tightly than `least`."""
        tokens = formula_tokens(inner, symbols, notation)
        return ("(", *tokens, ")") if _binding(inner, notation) < least else tokens

    match formula:
        case Expression("constant", value=value):
            yield notation.number(value)
        case Expression("variable", variable=index):
            yield symbols[index]
        case Expression("neg", (inner,)):
            yield "-"
            yield from operand(inner, _POWER)
        # An equal operator on the left needs no brackets, on the right it does.
        case Expression(operator, (left, right)):
            yield from operand(left, binding)
            yield f" {BINARY[operator]} " if binding == _SUM else BINARY[operator]
            yield from operand(right, binding + 1)
        case Expression(operator, (inner,)) if binding == _POWER:
            yield from operand(inner, _POWER + 1)
            yield f"**{_EXPONENTS[operator]}"
        case Expression(operator, (inner,)):
            yield f"{notation.function(operator)}("
            yield from operand(inner, _SUM)
            yield ")"


def _binding(formula: Expression, notation: Notation) -> int:
    if formula.operator == "constant" and formula.value < 0.0:
        return _SIGN
    if formula.operator in _EXPONENTS and notation.has_powers:
        return _POWER
    return _BINDING.get(formula.operator, _POWER + 1)
