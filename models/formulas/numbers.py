"""The numbers in a formula, from left to right, and formulas with others in their place."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import repeat

from glassgait.models.formulas.expression import (
    ZERO,
    Expression,
    constant,
    negated,
    plus,
    variable,
)


def numbers_of(formula: Expression) -> Iterator[float]:
    """Lists the constants of a formula, from left to right."""
    if formula.operator == "constant":
        yield formula.value
    for operand in formula.operands:
        yield from numbers_of(operand)


def with_numbers(formula: Expression, numbers: Iterator[float]) -> Expression:
    """Puts the next of `numbers` in the place of a formula's constants."""
    return _with_leaves(formula, map(constant, numbers))


@dataclass(frozen=True)
class WeightedSum:
    """A formula as a sum of terms, each multiplied by a number of its own.

    Attributes:
        terms: What each of the formula's numbers multiplies, from left to right.
        rest: What no number multiplies.
    """

    terms: tuple[Expression, ...]
    rest: Expression

    @classmethod
    def of(cls, formula: Expression) -> "WeightedSum | None":
        """Splits a formula; returns None where a number is in a function or multiplies another."""
        first = max(formula.variables, default=-1) + 1
        numbers = range(first, first + len([*numbers_of(formula)]))
        opened = _with_leaves(formula, map(variable, numbers))
        terms = tuple(map(opened.derivative, numbers))
        if any(not term.variables.isdisjoint(numbers) for term in terms):
            return None
        return cls(terms, without_zeros(with_numbers(formula, repeat(0.0))))


def without_zeros(formula: Expression) -> Expression:
    """Leaves out what is multiplied by 0."""
    if not formula.operands:
        return formula
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
        case operator, _:
            return Expression(operator, operands)


def _with_leaves(formula: Expression, leaves: Iterator[Expression]) -> Expression:
    if formula.operator == "constant":
        return next(leaves)
    if not formula.operands:
        return formula
    operands = tuple(_with_leaves(operand, leaves) for operand in formula.operands)
    return Expression(formula.operator, operands)
