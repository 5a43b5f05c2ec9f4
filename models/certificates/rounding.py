"""Bounds of how far a target in double precision may be from the exact one.

Bounds are of exact formulas; robots evaluate them from left to right in double precision. Each node
of a formula is bounded over the whole box, and with it the error of its computed value: the running
error of Higham, Accuracy and Stability of Numerical Algorithms, section 3.3.
"""

from functools import cache

import numpy as np

from glassgait.models.certificates.maximum import Region
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.interval import OPERATORS, Interval
from glassgait.models.formulas.quantities import RobotUnits

UNIT, LIBRARY = 2.0**-53, 16
"""Error of one operation, as a share of its result, and that of a function, in such units.

Functions of NumPy and of C libraries are within 4 units of the last place."""

SMALLEST, GREATEST = 2.0**-1000, 1e300
"""More than is lost where a result is too small for all its digits, and the greatest result."""

LARGEST_ERROR = 1e-9
"""Error of a target (rad) beyond which nothing is proved of it."""

MARGIN = 1.0 + 1e-6
"""Factor of all errors: the checker computes them in another way."""

FUNCTIONS = ("sin", "cos", "tanh")
"""The functions whose error is bounded: none has a slope above 1."""

Ranged = tuple[Interval, float]
"""Exact values, and the greatest error."""


def formula_error(formula: Expression, joint: int, read: Region, units: RobotUnits) -> float:
    """Bounds the error of a joint's target that is a formula of observed quantities (rad).

    Raises:
        InputError: if the error may exceed `LARGEST_ERROR`, or the formula may divide by 0 or
            has a function other than `FUNCTIONS`.
    """

    @cache
    def ranged(node: Expression) -> Ranged:
        match node.operator:
            case "constant":
                return Interval.point(node.value, ()), 0.0
            case "variable":
                low, high = read.lower[node.variable], read.upper[node.variable]
                values = Interval(np.asarray(low), np.asarray(high))
                shift = abs(float(units.offset[node.variable]))
                return values, 4.0 * UNIT * (_size(values) + shift)
        parts = [ranged(operand) for operand in node.operands]
        if node.operator == "neg":
            return -parts[0][0], parts[0][1]
        error = _propagated(node.operator, *parts)
        values = OPERATORS[node.operator](*(values for values, _ in parts))
        share = LIBRARY if node.operator in FUNCTIONS else 2
        error += share * UNIT * (_size(values) + error) + SMALLEST
        if not _size(values) + error < GREATEST:
            raise InputError(f"{node.operator} may overflow; nothing is proved of such a formula")
        return values, error

    values, error = ranged(formula)
    stance = abs(float(units.robot.default_stance[joint]))
    # A policy returns an action, which the robot turns into the target again.
    error = MARGIN * (error + 4.0 * UNIT * (_size(values) + error + stance))
    if not error <= LARGEST_ERROR:
        raise InputError(
            f"in double precision a target may be off by {error:.2g} rad, more than "
            f"{LARGEST_ERROR:g}; fit smaller numbers"
        )
    return error


def _propagated(operator: str, *operands: Ranged) -> float:
    """Returns the error that the operands' errors cause."""
    first, last = operands[0], operands[-1]
    match operator:
        case "add" | "sub":
            return first[1] + last[1]
        case "mul" | "square":
            return _product_error(first, last)
        case "cube":
            # The first product is rounded, too.
            squared, error = first[0] * first[0], _product_error(first, first)
            error += 2.0 * UNIT * (_size(squared) + error)
            return _product_error((squared, error), first)
        case "div":
            away = float(max(last[0].lower, -last[0].upper))
            if not away > last[1]:
                raise InputError("a divisor may be 0 in the box; nothing is proved of the formula")
            quotient = _size(OPERATORS["div"](first[0], last[0]))
            return (first[1] + quotient * last[1]) / (away - last[1])
        case "sin" | "cos" | "tanh":
            return first[1]
    raise InputError(f"a formula holds {operator}; claims are proved of + - * / sin cos tanh only")


def _product_error(a: Ranged, b: Ranged) -> float:
    return _size(a[0]) * b[1] + _size(b[0]) * a[1] + a[1] * b[1]


def _size(values: Interval) -> float:
    return float(values.magnitude)
