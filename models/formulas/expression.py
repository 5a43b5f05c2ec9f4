"""Formulas as expression trees, their numbers, and their canonical form."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import repeat

from glassgait.models.errors import InputError, shown

BINARY = {"add": "+", "sub": "-", "mul": "*", "div": "/"}
UNARY = ("neg", "sin", "cos", "tanh", "exp", "log", "sqrt", "abs", "square", "cube")

MAX_DEPTH = 100  # greatest depth of a formula, since functions of formulas are recursive
LARGEST = 1e30  # greatest magnitude of a number, so that products of a few stay finite

MAX_NODES = 5000
MAX_TERMS = 1000  # greatest number of terms up to which products of sums are multiplied out

_ARITY = {"constant": 0, "variable": 0} | dict.fromkeys(BINARY, 2) | dict.fromkeys(UNARY, 1)


@dataclass(frozen=True)
class Expression:
    """A formula, whose operator is "constant", "variable", or a name in `BINARY` or `UNARY`."""

    operator: str
    operands: tuple["Expression", ...] = ()
    value: float = 0.0
    variable: int = -1

    @cached_property
    def length(self) -> int:
        """Number of nodes; a weighted variable counts as one, as in Operon."""
        match self:
            case Expression("mul", (Expression("constant"), Expression("variable"))):
                return 1
            case _:
                return 1 + sum(operand.length for operand in self.operands)

    @cached_property
    def variables(self) -> frozenset[int]:
        if self.operator == "variable":
            return frozenset([self.variable])
        return frozenset().union(*(operand.variables for operand in self.operands))

    @cached_property
    def n_terms(self) -> int:
        """Number of terms after multiplying out all products of sums."""
        counts = [operand.n_terms for operand in self.operands]
        match self.operator:
            case "add" | "sub":
                return sum(counts)
            case "mul" | "neg":
                return math.prod(counts)
            case _:
                return 1

    def terms(self) -> tuple["Expression", ...]:
        """Splits the formula into terms that add up to it, and multiplies out products of sums.

        Products are not multiplied out if there would be more than `MAX_TERMS` terms.
        """
        return self._terms(multiply_out=self.n_terms <= MAX_TERMS)

    def _terms(self, multiply_out: bool) -> tuple["Expression", ...]:
        splits = ("add", "sub", "neg", "mul") if multiply_out else ("add", "sub", "neg")
        operands = self.operands if self.operator in splits else ()
        parts = [operand._terms(multiply_out) for operand in operands]
        match self.operator, parts:
            case "add", (left, right):
                return left + right
            case "sub", (left, right):
                return left + tuple(negated(term) for term in right)
            case "neg", (inner,):
                return tuple(negated(term) for term in inner)
            case "mul", (left, right):
                return tuple(times(a, b) for a in left for b in right)
            case _:
                return (self,)

    def replaced(self, images: Mapping[int, "Expression"]) -> "Expression":
        """Replaces variables by formulas; a sub-formula without any stays the same object."""
        if self.operator == "variable":
            return images.get(self.variable, self)
        return self.with_operands(tuple(operand.replaced(images) for operand in self.operands))

    def with_operands(self, operands: tuple["Expression", ...]) -> "Expression":
        """Returns the formula with other operands; the same object if they are the same."""
        pairs = zip(operands, self.operands, strict=True)
        same = all(new is old for new, old in pairs)
        return self if same else Expression(self.operator, operands)

    def derivative(self, variable: int) -> "Expression":
        if variable not in self.variables:
            return ZERO
        # Apply the sum, product and chain rules, leaving out zeros and ones.
        slopes = tuple(operand.derivative(variable) for operand in self.operands)
        match self.operator, self.operands:
            case "variable", _:
                return ONE
            case "add", _:
                return plus(*slopes)
            case "sub", _:
                return plus(slopes[0], negated(slopes[1]))
            case "mul", (left, right):
                return plus(times(slopes[0], right), times(left, slopes[1]))
            case "div", (left, right):
                rest = times(self, slopes[1])
                return Expression("div", (plus(slopes[0], negated(rest)), right))
            case operator, (inner,):
                return times(_outer_slope(operator, self, inner), slopes[0])
        raise AssertionError(self.operator)


def constant(value: float) -> Expression:
    return Expression("constant", value=value)


def variable(index: int) -> Expression:
    return Expression("variable", variable=int(index))


def scaled(formula: Expression, factor: float) -> Expression:
    """Multiplies a formula by a number, even by 1, so that it stays a weighted variable."""
    return Expression("mul", (constant(factor), formula))


ZERO, ONE = constant(0.0), constant(1.0)


def plus(left: Expression, right: Expression) -> Expression:
    """Adds two formulas, leaving out zeros."""
    if ZERO in (left, right):
        return right if left == ZERO else left
    return Expression("add", (left, right))


def times(left: Expression, right: Expression) -> Expression:
    """Multiplies two formulas, leaving out zeros and ones and joining constants."""
    if ZERO in (left, right):
        return ZERO
    if ONE in (left, right):
        return right if left == ONE else left
    if left.operator == right.operator == "constant":
        return constant(left.value * right.value)
    return Expression("mul", (left, right))


def negated(formula: Expression) -> Expression:
    is_number = formula.operator == "constant"
    return constant(-formula.value) if is_number else Expression("neg", (formula,))


def _outer_slope(operator: str, whole: Expression, inner: Expression) -> Expression:
    slopes = {
        "neg": constant(-1.0),
        "sin": Expression("cos", (inner,)),
        "cos": negated(Expression("sin", (inner,))),
        "tanh": plus(ONE, negated(Expression("square", (whole,)))),
        "exp": whole,
        "log": Expression("div", (ONE, inner)),
        "sqrt": Expression("div", (constant(0.5), whole)),
        "abs": Expression("div", (inner, whole)),
        "square": times(constant(2.0), inner),
        "cube": times(constant(3.0), Expression("square", (inner,))),
    }
    return slopes[operator]


def canonical(formula: Expression) -> Expression:
    """Moves the minus signs of a formula to the front without changing its value.

    Reading the text of the result gives the same tree. Values stay equal to the last digit; only
    the sign of a zero may change, and with it the sign of a quotient by this zero. Minus signs
    remain between terms, at the start of a product or quotient, and before divisors.
    """
    operands = tuple(canonical(operand) for operand in formula.operands)
    match formula.operator, operands:
        case "constant", _:
            # The notation has no negative zero.
            return formula if formula.value else constant(0.0)
        case "neg", (inner,):
            return negative(inner)
        case "mul", (left, right) if is_negative(right):
            return Expression("mul", (negative(left), negative(right)))
        case "add", (left, right) if is_negative(right):
            return Expression("sub", (left, negative(right)))
        case "sub", (left, right) if is_negative(right):
            return Expression("add", (left, negative(right)))
    return formula.with_operands(operands)


def negative(formula: Expression) -> Expression:
    """Returns the negative of a canonical formula, in canonical form."""
    match formula:
        case Expression("constant", value=value):
            return constant(0.0 - value)
        case Expression("neg", (inner,)):
            return inner
        case Expression("add", (left, right)):
            return Expression("sub", (negative(left), right))
        case Expression("sub", (left, right)):
            return Expression("add", (negative(left), right))
        case Expression(("mul" | "div") as operator, (left, right)):
            return Expression(operator, (negative(left), right))
        case _:
            return Expression("neg", (formula,))


def is_negative(formula: Expression) -> bool:
    """Returns whether a canonical formula begins with a minus sign that applies to all of it."""
    match formula:
        case Expression("constant", value=value):
            return value < 0.0
        case Expression("neg"):
            return True
        case Expression("mul" | "div", (left, _)):
            return is_negative(left)
        case _:
            return False


def numbers_of(formula: Expression) -> Iterator[float]:
    """Lists a formula's constants from left to right."""
    if formula.operator == "constant":
        yield formula.value
    for operand in formula.operands:
        yield from numbers_of(operand)


def with_numbers(formula: Expression, numbers: Iterator[float]) -> Expression:
    """Replaces a formula's constants by `numbers`, from left to right."""
    return _with_leaves(formula, map(constant, numbers))


@dataclass(frozen=True)
class WeightedSum:
    """A formula as a sum of numbers times terms, plus a rest.

    Attributes:
        terms: The term that each number of the formula multiplies, from left to right.
        rest: The sum of the terms that no number multiplies.
    """

    terms: tuple[Expression, ...]
    rest: Expression

    @classmethod
    def of(cls, formula: Expression) -> "WeightedSum | None":
        """Splits a formula; returns None if a number is in a function or multiplies another."""
        # Replace the numbers by variables. The formula is linear in them if its derivatives by
        # them do not contain them.
        first = max(formula.variables, default=-1) + 1
        numbers = range(first, first + len([*numbers_of(formula)]))
        opened = _with_leaves(formula, map(variable, numbers))
        terms = tuple(map(opened.derivative, numbers))
        if any(not term.variables.isdisjoint(numbers) for term in terms):
            return None
        return cls(terms, without_zeros(with_numbers(formula, repeat(0.0))))


def without_zeros(formula: Expression) -> Expression:
    """Removes sub-formulas that are multiplied by 0."""
    operands = tuple(without_zeros(operand) for operand in formula.operands)
    match formula.operator, operands:
        case "add", (left, right):
            return plus(left, right)
        case "sub", (left, right) if ZERO in (left, right):
            return left if right == ZERO else negated(right)
        case "mul", _ if ZERO in operands:
            return ZERO
        case (("div" | "neg"), (left, *_)) if left == ZERO:
            return ZERO
        case _:
            return formula.with_operands(operands)


def _with_leaves(formula: Expression, leaves: Iterator[Expression]) -> Expression:
    if formula.operator == "constant":
        return next(leaves)
    operands = tuple(_with_leaves(operand, leaves) for operand in formula.operands)
    return formula.with_operands(operands)


def checked_formula(formula: Expression, n_variables: int) -> Expression:
    """Checks a formula by `refuse_unfit` and returns its canonical form."""
    refuse_unfit(formula, n_variables)
    formula = canonical(formula)
    # A sign that moved may have made the formula one level deeper.
    refuse_unfit(formula, n_variables)
    return formula


def refuse_unfit(formula: Expression, n_variables: int) -> None:
    """Raises InputError if a formula is too large, malformed or has a variable beyond the last."""
    # List the nodes to visit, since a formula may be deeper than Python's stack.
    pending, n_nodes = [(formula, 1)], 0
    while pending:
        node, depth = pending.pop()
        n_nodes += 1
        if n_nodes > MAX_NODES:
            raise InputError(f"a formula has more than {MAX_NODES} nodes; fit a shorter one")
        if depth > MAX_DEPTH:
            raise InputError(f"a formula is nested more than {MAX_DEPTH} deep; fit a shorter one")
        if fault := _fault(node, n_variables):
            raise InputError(f"a formula {fault}; fit it again")
        pending += [(operand, depth + 1) for operand in node.operands]


def _fault(node: Expression, n_variables: int) -> str | None:
    if len(node.operands) != _ARITY.get(node.operator):
        return f"applies {shown(node.operator)} to {len(node.operands)} operands"
    if node.operator == "constant" and not abs(node.value) <= LARGEST:
        return f"holds the number {node.value}, which is not from {-LARGEST:g} to {LARGEST:g}"
    if node.operator == "variable" and not 0 <= node.variable < n_variables:
        return f"uses observation {node.variable} of {n_variables}"
    return None
