"""Typeset formulas: the notation of formula files as LaTeX.

Beside formulas, the tree that Python's parser gives holds what the programs of a file have:
comparisons, choices and functions of vectors. Nothing is evaluated.
"""

import ast
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from glassgait.models.formulas.text import written_number

_SIGNS = {
    ast.Lt: ("<", "<"),
    ast.Gt: (">", ">"),
    ast.Eq: ("=", "="),
    ast.And: (r"\wedge", "∧"),
    ast.BitAnd: (r"\wedge", "∧"),
    ast.Or: (r"\vee", "∨"),
    ast.BitOr: (r"\vee", "∨"),
}
"""Operators between two sides, as LaTeX and in MathML."""

NOT = (r"\neg", "¬")
CROSS, DOT = (r"\times", "×"), (r"\cdot", "·")
PLUS, MINUS, EQUALS = ("+", "+"), ("-", "−"), ("=", "=")
IF_AND_ONLY_IF = (r"\Leftrightarrow", "⇔")

Sign = tuple[str, str]
"""An operator, as LaTeX and in MathML."""


class Markup(ABC):
    """How a language writes mathematics; symbols are given as LaTeX."""

    @abstractmethod
    def number(self, value: float) -> str:
        """Writes a number that is not negative."""

    @abstractmethod
    def symbol(self, latex: str) -> str:
        """Writes a symbol."""

    @abstractmethod
    def sign(self, sign: Sign, *, between: bool = True) -> str:
        """Writes an operator, between two sides or before its one side."""

    @abstractmethod
    def function(self, name: str) -> str:
        """Writes the name of a function."""

    @abstractmethod
    def fraction(self, above: str, below: str) -> str:
        """Writes a quotient."""

    @abstractmethod
    def power(self, base: str, exponent: int) -> str:
        """Writes a power of what is in brackets, or is a symbol."""

    @abstractmethod
    def fenced(self, inner: str, left: str, right: str) -> str:
        """Writes brackets, or bars, around a whole."""

    @abstractmethod
    def bracket(self, sign: str) -> str:
        """Writes one bracket, whose other one may stand in another line."""

    @abstractmethod
    def cases(self, value: str, condition: str, other: str) -> str:
        """Writes a choice: a value where a condition holds, and the other one elsewhere."""

    @abstractmethod
    def joined(self, parts: Sequence[str], *, apart: bool = False) -> str:
        """Writes parts one after the other; factors stand a little apart."""


class Latex(Markup):
    """Writes LaTeX that needs amsmath."""

    def number(self, value: float) -> str:
        mantissa, _, exponent = written_number(value).partition("e")
        return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa

    def symbol(self, latex: str) -> str:
        return latex

    def sign(self, sign: Sign, *, between: bool = True) -> str:
        if between:
            return f" {sign[0]} "
        return f"{sign[0]} " if sign[0].startswith("\\") else sign[0]

    def function(self, name: str) -> str:
        known = name in ("sin", "cos", "tanh", "exp", "log", "min")
        return f"\\{name}" if known else rf"\operatorname{{{name}}}"

    def fraction(self, above: str, below: str) -> str:
        return rf"\frac{{{above}}}{{{below}}}"

    def power(self, base: str, exponent: int) -> str:
        return rf"{{{base}}}^{{{exponent}}}"

    def fenced(self, inner: str, left: str, right: str) -> str:
        return rf"\left{_bar(left)}{inner}\right{_bar(right)}"

    def bracket(self, sign: str) -> str:
        return sign

    def cases(self, value: str, condition: str, other: str) -> str:
        rows = (
            rf"{value} & \text{{if }} {condition} \\",
            rf"{other} & \text{{else}}",
        )
        return "\\begin{cases} " + " ".join(rows) + " \\end{cases}"

    def joined(self, parts: Sequence[str], *, apart: bool = False) -> str:
        return (r" \, " if apart else "").join(parts)


def _bar(sign: str) -> str:
    return r"\|" if sign == "‖" else sign


_SUM, _PRODUCT, _POWER, _ATOM = range(4)
_FENCES = {"abs": ("|", "|"), "norm": ("‖", "‖")}
_BETWEEN = {"cross": CROSS, "dot": DOT}


@dataclass(frozen=True)
class Typesetter:
    """Typesets what stands in a formula file.

    Attributes:
        markup: The language.
        symbols: The symbol of each name, as LaTeX; a name that has none is written upright.
    """

    markup: Markup
    symbols: Mapping[str, str] = field(default_factory=dict)

    def whole(self, text: str) -> str:
        """Typesets a formula, or the right side of a statement, in one piece."""
        return self._sum(_parsed(text))

    def pieces(self, text: str) -> list[str]:
        """Typesets a formula in pieces that begin with their sign: a line may end between two.

        The terms of a bracket are pieces of their own.
        """
        return self._terms(_parsed(text))

    def relation(self, text: str) -> str:
        """Typesets what stands between a name and what it is: a truth holds where another does."""
        is_truth = isinstance(_parsed(text), ast.Compare | ast.BoolOp)
        return self.markup.sign(IF_AND_ONLY_IF if is_truth else EQUALS)

    def name(self, name: str) -> str:
        """Typesets a name."""
        return self.markup.symbol(self.symbols.get(name) or _upright(name))

    def _terms(self, node: ast.expr) -> list[str]:
        match node:
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
                sign = self.markup.sign(PLUS if isinstance(op, ast.Add) else MINUS)
                first, *rest = self._term(right)
                return [*self._terms(left), sign + first, *rest]
        positive = _without_minus(node)
        if positive is None:
            return self._term(node, first=True)
        first, *rest = self._term(positive)
        return [self.markup.sign(MINUS, between=False) + first, *rest]

    def _term(self, node: ast.expr, *, first: bool = False) -> list[str]:
        """Typesets a term; a product that ends in a bracket is in as many pieces as that."""
        bracket = self.markup.bracket
        match node:
            case ast.BinOp(left=left, op=ast.Mult(), right=right) if _binding(right) == _SUM:
                inner = self._terms(right)
                inner[0] = self._factor(left) + bracket("(") + inner[0]
                inner[-1] += bracket(")")
                return inner
        return [self._expression(node) if first else self._operand(node, _PRODUCT)]

    def _sum(self, node: ast.expr) -> str:
        return self.markup.joined(self._terms(node))

    def _factor(self, node: ast.expr) -> str:
        return self._operand(node, _PRODUCT)

    def _operand(self, node: ast.expr, least: int) -> str:
        """Typesets an operand, in brackets where it binds less than its operator asks for."""
        if _binding(node) >= least:
            return self._expression(node)
        return self.markup.bracket("(") + self._sum(node) + self.markup.bracket(")")

    def _expression(self, node: ast.expr) -> str:
        markup = self.markup
        match node:
            case ast.Constant(value=int() | float() as value):
                return markup.number(float(value))
            case ast.Name() | ast.Attribute():
                return self.name(ast.unparse(node))
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=operand):
                return markup.sign(NOT, between=False) + self._operand(operand, _ATOM)
            case ast.UnaryOp(op=ast.USub()):
                return self._sum(node)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                if isinstance(right, ast.Constant):
                    return self._factor(left) + markup.sign(DOT) + self._expression(right)
                factors = [self._factor(left), self._operand(right, _POWER)]
                return markup.joined(factors, apart=True)
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                return markup.fraction(self._sum(left), self._sum(right))
            case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as exponent)):
                return markup.power(self._operand(left, _ATOM), exponent)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self._sum(node)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self._call(name, arguments)
            case _:
                return self._logic(node)

    def _call(self, name: str, arguments: Sequence[ast.expr]) -> str:
        markup = self.markup
        if name in _BETWEEN:
            left, right = (self._operand(own, _PRODUCT) for own in arguments)
            return left + markup.sign(_BETWEEN[name]) + right
        written = ", ".join(self._sum(own) for own in arguments)
        if name in _FENCES:
            return markup.fenced(written, *_FENCES[name])
        return markup.function(name) + markup.fenced(written, "(", ")")

    def _logic(self, node: ast.expr) -> str:
        match node:
            case ast.IfExp(body=value, test=condition, orelse=other):
                return self.markup.cases(
                    self._sum(value), self._expression(condition), self._sum(other)
                )
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                return self._sum(left) + self.markup.sign(_SIGNS[type(op)]) + self._sum(right)
            case ast.BoolOp(op=op, values=values):
                sides = [self._operand(own, _PRODUCT) for own in values]
                return self.markup.sign(_SIGNS[type(op)]).join(sides)
            case ast.BinOp(left=left, op=ast.BitAnd() | ast.BitOr() as op, right=right):
                sign = self.markup.sign(_SIGNS[type(op)])
                return self._operand(left, _PRODUCT) + sign + self._operand(right, _PRODUCT)
        raise AssertionError(ast.unparse(node))


def _parsed(text: str) -> ast.expr:
    return ast.parse(" ".join(text.split()), mode="eval").body


def _without_minus(node: ast.expr) -> ast.expr | None:
    """Returns a term without the minus that it begins with; none where it begins with none."""
    match node:
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return operand
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            positive = _without_minus(left)
            return None if positive is None else ast.BinOp(positive, op, right)
    return None


def _binding(node: ast.expr) -> int:
    """Returns how tightly an expression holds together."""
    match node:
        case ast.BinOp(op=ast.Add() | ast.Sub() | ast.BitOr()) | ast.UnaryOp(op=ast.USub()):
            return _SUM
        case ast.IfExp() | ast.BoolOp(op=ast.Or()):
            return _SUM
        case ast.BinOp(op=ast.Pow() | ast.Div()):
            return _POWER
        case ast.BinOp() | ast.Compare() | ast.BoolOp():
            return _PRODUCT
        case ast.Call(func=ast.Name(id=name)) if name in _BETWEEN:
            return _PRODUCT
    return _ATOM


def _upright(name: str) -> str:
    """Returns the symbol of a word: a leg's name is an index, and the step before a minus."""
    base, _, index = name.partition(".")
    symbol = base if len(base) == 1 else rf"\mathrm{{{base}}}"
    if index == "before":
        return f"{symbol}^{{-}}"
    return rf"{symbol}_{{\mathrm{{{index}}}}}" if index else symbol
