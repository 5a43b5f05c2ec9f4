"""Bounds of formulas over boxes of their variables, by interval arithmetic."""

from collections.abc import Mapping

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import Expression, constant

Interval = tuple[Array, Array]
"""Least and greatest values; of several boxes, arrays of equal shape."""

_RISING = {"tanh": np.tanh, "exp": np.exp, "log": np.log, "sqrt": np.sqrt}


def bounds_of(formula: Expression, boxes: Mapping[int, Interval]) -> Interval:
    """Bounds a formula's values from below and above.

    Bounds hold but for rounding errors, and are exact where a box is a point. Where the formula is
    not finite all over a box they are infinite or not a number.

    Args:
        formula: The formula.
        boxes: Least and greatest value of each of its variables, of m boxes (m).

    Returns:
        Least and greatest values (m), or numbers of a formula without variables.
    """
    with np.errstate(all="ignore"):
        return _bounds(formula, boxes)


def with_values(formula: Expression, values: Mapping[int, float]) -> Expression:
    """Puts numbers in for variables, and works out what no variable is left in."""
    if formula.operator == "variable":
        value = values.get(formula.variable)
        return formula if value is None else constant(value)
    if not formula.operands:
        return formula
    operands = tuple(with_values(operand, values) for operand in formula.operands)
    put_in = Expression(formula.operator, operands)
    if any(operand.operator != "constant" for operand in operands):
        return put_in
    return constant(float(bounds_of(put_in, {})[0]))


def _bounds(formula: Expression, boxes: Mapping[int, Interval]) -> Interval:
    if formula.operator == "constant":
        value = np.float64(formula.value)
        return value, value  # type: ignore[return-value]
    if formula.operator == "variable":
        return boxes[formula.variable]
    operands = [_bounds(operand, boxes) for operand in formula.operands]
    match formula.operator, operands:
        case "add", ((a, b), (c, d)):
            return a + c, b + d
        case "sub", ((a, b), (c, d)):
            return a - d, b - c
        case "mul", (left, right):
            # A square is no product of two numbers that go their own ways.
            same = formula.operands[0] == formula.operands[1]
            return _square(left) if same else _product(left, right)
        case "div", (left, (c, d)):
            through_zero = (c <= 0) & (d >= 0)
            low, high = _product(left, (1.0 / d, 1.0 / c))
            return np.where(through_zero, -np.inf, low), np.where(through_zero, np.inf, high)
        case operator, (inner,):
            return _of_function(operator, inner)
    raise AssertionError(formula.operator)


def _of_function(operator: str, inner: Interval) -> Interval:
    low, high = inner
    match operator:
        case "neg":
            return -high, -low
        case "square":
            return _square(inner)
        case "abs":
            low, high = _square(inner)
            return np.sqrt(low), np.sqrt(high)
        case "cube":
            return low * low * low, high * high * high
        case "sin":
            return _cosine((low - np.pi / 2, high - np.pi / 2))
        case "cos":
            return _cosine(inner)
        case rising:
            return _RISING[rising](low), _RISING[rising](high)


def _product(left: Interval, right: Interval) -> Interval:
    corners = [a * b for a in left for b in right]
    return np.minimum.reduce(corners), np.maximum.reduce(corners)


def _square(inner: Interval) -> Interval:
    low, high = inner
    a, b = low * low, high * high
    return np.where((low <= 0) & (high >= 0), 0.0, np.minimum(a, b)), np.maximum(a, b)


def _cosine(inner: Interval) -> Interval:
    low, high = inner
    a, b = np.cos(low), np.cos(high)
    # A top lies at every even multiple of π, a bottom at every odd one.
    top = np.ceil(low / (2 * np.pi)) * 2 * np.pi <= high
    bottom = (np.ceil((low - np.pi) / (2 * np.pi)) * 2 + 1) * np.pi <= high
    return np.where(bottom, -1.0, np.minimum(a, b)), np.where(top, 1.0, np.maximum(a, b))
