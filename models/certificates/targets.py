"""Bounds the joint targets of a policy's formulas over boxes.

Bounds are those of exact arithmetic. The error of double precision is the running error (Higham,
Accuracy and Stability of Numerical Algorithms, section 3.3) of each node over the whole box.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Literal

import numpy as np

from glassgait.models.certificates.box import ObservationBox
from glassgait.models.certificates.maximum import Maximum, Region, maximize
from glassgait.models.certificates.polynomial import (
    Polynomial,
    PolynomialRing,
    Relaxation,
    combined,
)
from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, variable
from glassgait.models.formulas.interval import OPERATORS, Interval
from glassgait.models.formulas.mirror import observed_images
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import REFLECT_JOINTS, indices_of

UNIT, LIBRARY = 2.0**-53, 16
"""Relative error of one operation, and of a function in units of it.

Functions of NumPy and of C libraries are within 4 units in the last place."""

SMALLEST, GREATEST = 2.0**-1000, 1e300
"""More than the error by underflow, and the greatest result that is accepted."""

LARGEST_ERROR = 1e-9  # greatest error of a target about which claims are proved (rad)
MARGIN = 1.0 + 1e-6  # factor on all errors, because the checker computes them in another way

FUNCTIONS = ("sin", "cos", "tanh")
"""The functions whose error is bounded; their slopes are at most 1."""


@dataclass(frozen=True)
class Query:
    """A quantity to bound over a box, times a sign of 1 or -1.

    It is a joint's `target` (rad), its `slope` by an observation (rad per unit), or the `effect` of
    an observation: the target minus the target at another value of that observation (rad).
    """

    of: Literal["target", "slope", "effect"]
    state: int
    joint: int
    sign: int
    observation: int = -1


class FormulaTargets:
    """Bounds targets, slopes and effects over boxes with a fixed machine state."""

    def __init__(self, policy: FormulaPolicy) -> None:
        names = policy.observation_names
        self._names, self._n = names, len(names)
        self._units = RobotUnits.of(policy.robot, names)
        rows = [[*map(policy.vocabulary.expanded, row)] for row in policy.formulas_by_state]
        n_states = max(1, len(indices_of("machine state", names)))
        self._formulas = rows if len(rows) > 1 else rows * n_states
        readings, infinite = policy.readings, np.full(self._n, np.inf)
        self._ends = (-infinite, infinite) if readings is None else readings.ends(names)
        self._ring = PolynomialRing()
        self._polynomial = cache(self._multiplied_out)

    def used(self, state: int, joint: int) -> frozenset[int]:
        """Returns the quantities in a target's formula, including those that cancel out."""
        return self._formulas[state][joint].variables

    def rounding(self, state: int, joint: int, box: ObservationBox) -> float:
        """Bounds the error of a target in double precision (rad)."""
        return formula_error(self._formulas[state][joint], joint, self._read(box), self._units)

    def are_mirrored(self, images: Sequence[int]) -> bool:
        """Returns whether targets are mirror images of one another, given each state's image."""
        observed = dict(enumerate(observed_images(self._names, images)))
        return all(
            self._polynomial(Query("target", state, joint, 1))
            == self._image(image, int(REFLECT_JOINTS.index[joint]), observed)
            for state, image in enumerate(images)
            for joint in range(quadruped.N_JOINTS)
        )

    def bound(
        self, query: Query, box: ObservationBox, *, gap: float, threshold: float | None = None
    ) -> Maximum:
        """Bounds a quantity over a box with a fixed machine state; see `maximize`.

        The witness of an effect ends with the other value of the observation (n + 1).
        """
        ends, read = Region(box.lower, box.upper, box.counted), self._read(box)
        if query.of == "effect":
            ends, read = ends.with_copy(query.observation), read.with_copy(query.observation)
        tape = Tape([self._expression(query)], len(read.lower))
        maximum = maximize(
            lambda quantities: query.sign * tape(quantities)[..., 0],
            Relaxation(self._ring, self._polynomial(query)),
            read,
            gap=gap,
            threshold=threshold,
        )
        # A quantity that is read as an end of its range may have any value beyond it.
        maximum = replace(maximum, witness=np.clip(maximum.witness, ends.lower, ends.upper))
        is_slope = query.of == "slope"
        return self._flat_beyond(maximum, query.observation, ends) if is_slope else maximum

    def change(self, state: int, joint: int, index: int, most: float, box: ObservationBox) -> float:
        """Bounds the change of a target (rad) if a quantity changes by at most `most`."""
        read, steepest = self._read(box), 0.0
        for sign in (1, -1):
            slope = self._polynomial(Query("slope", state, joint, sign, index))
            bound = Relaxation(self._ring, slope).upper(read.lower[None], read.upper[None])
            steepest = max(steepest, float(bound[0]))
        return most * steepest

    def _read(self, box: ObservationBox) -> Region:
        """Clips a box to the ranges in which the formulas read quantities."""
        return Region(np.clip(box.lower, *self._ends), np.clip(box.upper, *self._ends), box.counted)

    def _flat_beyond(self, slope: Maximum, index: int, box: Region) -> Maximum:
        """Corrects a slope for a box that exceeds the range of a reading: there it is 0."""
        low, high = (ends[index] for ends in self._ends)
        if box.upper[index] < low or box.lower[index] > high:
            return replace(slope, bound=0.0, reached=0.0)
        is_beyond = box.lower[index] < low or box.upper[index] > high
        return replace(slope, bound=max(0.0, slope.bound)) if is_beyond else slope

    def _image(self, state: int, joint: int, observed: Mapping[int, Expression]) -> Polynomial:
        """Returns a joint's target for mirrored observations, mirrored and multiplied out."""
        mirrored = self._formulas[state][joint].replaced(observed)
        sign = Fraction(int(REFLECT_JOINTS.sign[joint]))
        return combined(self._ring.polynomial(mirrored), factor=sign)

    def _multiplied_out(self, query: Query) -> Polynomial:
        return combined(self._ring.polynomial(self._expression(query)), factor=Fraction(query.sign))

    def _expression(self, query: Query) -> Expression:
        formula = self._formulas[query.state][query.joint]
        match query.of:
            case "target":
                return formula
            case "slope":
                return formula.derivative(query.observation)
            case "effect":
                other = formula.replaced({query.observation: variable(self._n)})
                return Expression("sub", (formula, other))


Ranged = tuple[Interval, float]  # exact values, and the greatest error


def formula_error(formula: Expression, joint: int, read: Region, units: RobotUnits) -> float:
    """Bounds the error of a joint's target (rad) if its formula is computed in double precision."""

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
        if node.operator == "cube":
            # A cube is two rounded products.
            (base,) = node.operands
            return ranged(Expression("mul", (Expression("square", (base,)), base)))
        operands = [ranged(operand) for operand in node.operands]
        if node.operator == "neg":
            return -operands[0][0], operands[0][1]

        # An operation adds the rounding of its result to the operands' errors.
        error = _propagated(node.operator, *operands)
        values = OPERATORS[node.operator](*(values for values, _ in operands))
        rounding = (LIBRARY if node.operator in FUNCTIONS else 2) * UNIT
        error += rounding * (_size(values) + error) + SMALLEST
        if not _size(values) + error < GREATEST:
            raise InputError(f"{node.operator} may overflow; nothing is proved of such a formula")
        return values, error

    values, error = ranged(formula)
    stance = abs(float(units.robot.default_stance[joint]))
    # A policy returns an action, which the robot converts back to the target.
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
            return _size(first[0]) * last[1] + _size(last[0]) * first[1] + first[1] * last[1]
        case "div":
            away = float(max(last[0].lower, -last[0].upper))
            if not away > last[1]:
                raise InputError("a divisor may be 0 in the box; nothing is proved of the formula")
            quotient = _size(OPERATORS["div"](first[0], last[0]))
            return (first[1] + quotient * last[1]) / (away - last[1])
        case "sin" | "cos" | "tanh":
            return first[1]
    raise InputError(f"a formula holds {operator}; claims are proved of + - * / sin cos tanh only")


def _size(values: Interval) -> float:
    return float(values.magnitude)
