"""What double precision does to targets: how far a computed one may be from the exact one.

Bounds are of exact formulas; robots evaluate them from left to right in double precision. Each node
of a formula is bounded over the whole box, and with it the error of its computed value: the running
error of Higham, Accuracy and Stability of Numerical Algorithms, section 3.3.
"""

import numpy as np

from glassgait.models.certificates.question import Box
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.interval import OPERATORS, Interval
from glassgait.models.formulas.quantities import RobotUnits

UNIT = 2.0**-53
"""Error of one operation, as a share of its result."""

LIBRARY = 16
"""The same of a function, in units: NumPy's and C libraries' are within 4 of the last place."""

SMALLEST = 2.0**-1000
"""More than is lost where a result is too small for all its digits."""

GREATEST = 1e300
LARGEST_EXPONENT = 690.0

LARGEST_ERROR = 1e-9
"""Error of a target (rad) beyond which nothing is proved of it."""

MARGIN = 1.0 + 1e-6
"""What errors are multiplied by: a checker computes them in its own way."""

_APPLIED = ("sin", "cos", "tanh", "exp", "log", "sqrt", "abs")

Ranged = tuple[Interval, float]
"""Exact values, and the greatest error."""


def formula_error(formula: Expression, joint: int, region: Box, units: RobotUnits) -> float:
    """Bounds the error of a target that is a formula of observed quantities (rad).

    Args:
        formula: The formula.
        joint: The joint.
        region: The box.
        units: Of the observations that quantities are computed from.

    Raises:
        InputError: if the error may exceed `LARGEST_ERROR`, or the formula may have no value in the
            box.
    """
    values, error = _Rounding(region, units).ranged(formula)
    stance = abs(float(units.robot.default_stance[joint]))
    # A policy returns an action, which the robot turns into the target again.
    return _accepted(error + 4.0 * UNIT * (_size(values) + error + stance))


def _accepted(error: float) -> float:
    if not MARGIN * error <= LARGEST_ERROR:
        raise InputError(
            f"in double precision a target may be off by {error:.2g} rad, more than "
            f"{LARGEST_ERROR:g}; fit smaller numbers"
        )
    return MARGIN * error


class _Rounding:
    """Bounds values and errors over one box."""

    def __init__(self, region: Box, units: RobotUnits) -> None:
        self._region, self._units = region, units
        # Formulas outlive this object, so that a part is known by its place in memory.
        self._known: dict[int, Ranged] = {}

    def ranged(self, node: Expression) -> Ranged:
        if id(node) not in self._known:
            self._known[id(node)] = self._of(node)
        return self._known[id(node)]

    def _of(self, node: Expression) -> Ranged:
        match node.operator:
            case "constant":
                return Interval.point(node.value, ()), 0.0
            case "variable":
                ends = (own[node.variable] for own in (self._region.lower, self._region.upper))
                values = Interval(*map(np.asarray, ends))
                shift = abs(float(self._units.offset[node.variable]))
                return values, 4.0 * UNIT * (_size(values) + shift)
        parts = [self.ranged(operand) for operand in node.operands]
        if node.operator == "neg":
            return -parts[0][0], parts[0][1]
        values, error = _applied(node.operator, *parts)
        share = LIBRARY if node.operator in _APPLIED else 2
        error += share * UNIT * (_size(values) + error) + SMALLEST
        if not _size(values) + error < GREATEST:
            raise InputError(f"{node.operator} may overflow; nothing is proved of such a formula")
        return values, error


def _applied(operator: str, *operands: Ranged) -> Ranged:
    """Returns exact values and the error that operands bring along."""
    first, last = operands[0], operands[-1]
    (x, x_error), (y, y_error) = first, last
    values = OPERATORS[operator](*(own for own, _ in operands))
    match operator:
        case "add" | "sub":
            return values, x_error + y_error
        case "mul" | "square":
            return values, _product_error(first, last)
        case "cube":
            # The first product is rounded, too.
            squared, error = x * x, _product_error(first, first)
            error += 2.0 * UNIT * (_size(squared) + error)
            return values, _product_error((squared, error), first)
        case "div":
            away = float(max(y.lower, -y.upper))
            if not away > y_error:
                raise _without_value("a divisor may be 0")
            return values, (x_error + _size(values) * y_error) / (away - y_error)
        case "log" | "sqrt":
            away = float(x.lower) - x_error
            if not away > 0.0:
                raise _without_value(f"{operator} may be of what is not positive")
            return values, x_error / (away if operator == "log" else float(np.sqrt(away)))
        case "exp":
            most = float(x.upper) + x_error
            if not most < LARGEST_EXPONENT:
                raise _without_value("exp may overflow")
            return values, float(np.exp(most)) * x_error
        case "sin" | "cos":
            return Interval(np.asarray(-1.0), np.asarray(1.0)), x_error
        case _:
            return values, x_error


def _product_error(a: Ranged, b: Ranged) -> float:
    return _size(a[0]) * b[1] + _size(b[0]) * a[1] + a[1] * b[1]


def _size(values: Interval) -> float:
    return float(values.magnitude)


def _without_value(reason: str) -> InputError:
    return InputError(f"{reason} somewhere in the box; nothing is proved of such a formula")
