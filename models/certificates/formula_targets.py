"""Bounds of targets that are formulas, and of linear ones, which are formulas too."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.maximum import maximize
from glassgait.models.certificates.question import BoundQuery, Box, Maximum, with_copy
from glassgait.models.certificates.relaxation import Relaxation
from glassgait.models.certificates.rounding import formula_error, sum_error
from glassgait.models.formulas.expression import Expression, constant, variable
from glassgait.models.formulas.polynomial import (
    Polynomial,
    PolynomialRing,
    combined,
)
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.readings import Readings
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, Reflection, reflect_observation


class FormulaTargets:
    """Targets that are formulas of observed quantities."""

    def __init__(
        self,
        formulas: Sequence[Sequence[Expression]],
        units: RobotUnits,
        names: tuple[str, ...],
        weights: tuple[Array, Array] | None = None,
        readings: Readings | None = None,
    ) -> None:
        """
        Args:
            formulas: Formulas of the observed quantities, of each state (n_states, 12).
            units: Of the observations.
            names: Names of the observations (n).
            readings: In which ranges formulas read what is sensed; by default in any.
            weights: Of linear policies the weights (n_states, 12, n) and intercepts
                (n_states, 12) that robots add up.
        """
        self._weights = weights
        self._units = units
        self._formulas = formulas
        self._names, self._n = names, len(names)
        self._positions = indices_of("joint position", names)
        whole = np.full(self._n, np.inf)
        self._ends = (-whole, whole) if readings is None else readings.ends(names)
        self._ring = PolynomialRing()
        # The machine's state is held: formulas that serve all states have parts that are gone.
        self._polynomial = cache(self._of)

    @classmethod
    def of_formulas(cls, policy: FormulaPolicy) -> "FormulaTargets":
        """Takes the formulas of a policy."""
        n_states = _n_states(policy.observation_names)
        rows = [
            [policy.vocabulary.expanded(formula) for formula in row]
            for row in policy.formulas_by_state
        ]
        names = policy.observation_names
        units = RobotUnits.of(policy.robot, names)
        rows = rows if len(rows) > 1 else rows * n_states
        return cls(rows, units, names, readings=policy.readings)

    @classmethod
    def of_linear(cls, policy: LinearPolicy) -> "FormulaTargets":
        """Writes weighted sums of observations as formulas of quantities."""
        n_states = _n_states(policy.observation_names)
        shape = (-1, quadruped.N_JOINTS)
        intercepts = np.tile(policy.intercepts.reshape(shape), (n_states, 1))
        weights = np.tile(
            policy.weights.reshape(*shape, policy.weights.shape[-1]), (n_states, 1, 1)
        )
        units = RobotUnits.of(policy.robot, policy.observation_names)
        rows = [
            [
                _weighted_sum(weights[state, joint], intercepts[state, joint], units, joint)
                for joint in range(quadruped.N_JOINTS)
            ]
            for state in range(n_states)
        ]
        return cls(rows, units, policy.observation_names, (weights, intercepts))

    def used(self, state: int, joint: int) -> frozenset[int]:
        """Returns the quantities that a target is written with, also those that cancel out."""
        return self._formulas[state][joint].variables

    def rounding(self, state: int, joint: int, region: Box) -> float:
        region = self._read(region)
        if self._weights is None:
            formula = self._formulas[state][joint]
            return formula_error(formula, joint, region, self._units)
        weights, intercept = self._weights[0][state, joint], self._weights[1][state, joint]
        ends = self._units.observed(np.stack([region.lower, region.upper]))
        sizes = np.abs(weights) * np.abs(ends).max(axis=0)
        return sum_error(self._units.robot, [abs(float(intercept)), *sizes.tolist()], joint)

    def are_mirrored(self, images: Sequence[int]) -> bool:
        """Returns whether the targets, multiplied out, are mirror images of one another.

        Args:
            images: State that each state of the machine is in the mirror.
        """
        reflection = reflect_observation(self._names, images)
        return all(
            self._polynomial(BoundQuery("target", state, joint, 1))
            == self._image(image, int(REFLECT_JOINTS.index[joint]), reflection)
            for state, image in enumerate(images)
            for joint in range(quadruped.N_JOINTS)
        )

    def answer(
        self, question: BoundQuery, region: Box, *, gap: float, threshold: float | None = None
    ) -> Maximum:
        read, beyond = self._read(region), self._beyond(question, region)
        if question.of == "effect":
            region, read = (with_copy(own, _observation_of(question)) for own in (region, read))
        relaxation = Relaxation(self._ring, self._polynomial(question))
        tape = Tape([self._asked(question)], len(read.lower))
        found = maximize(
            lambda quantities: question.sign * tape(quantities)[..., 0],
            relaxation,
            read,
            gap=gap,
            threshold=None if threshold is None else threshold - beyond,
        )
        # What is read at an end of a range may be anywhere beyond it.
        witness = np.clip(found.witness, region.lower, region.upper)
        reached = found.reached
        if question.of == "offset":
            angle = self._positions[question.joint]
            witness[angle] = self._furthest(question, float(found.witness[angle]), region)
            reached += question.sign * float(found.witness[angle] - witness[angle])
        found = replace(found, bound=found.bound + beyond, reached=reached, witness=witness)
        return self._flat_beyond(found, question, region) if question.of == "slope" else found

    def _furthest(self, question: BoundQuery, read: float, region: Box) -> float:
        """Returns the angle of a box that is read so, and from which a target is furthest."""
        index = self._positions[question.joint]
        low, high = (float(own[index]) for own in self._ends)
        first, last = float(region.lower[index]), float(region.upper[index])
        if low < read < high:
            return read
        # All that is beyond an end is read as it.
        first, last = (first, min(last, low)) if read <= low else (max(first, high), last)
        return first if question.sign > 0 else last

    def _read(self, region: Box) -> Box:
        """Returns what formulas read of a box."""
        return replace(
            region,
            lower=np.clip(region.lower, *self._ends),
            upper=np.clip(region.upper, *self._ends),
        )

    def _flat_beyond(self, found: Maximum, question: BoundQuery, region: Box) -> Maximum:
        """Returns what is known of a slope where a box goes beyond a range: there it is 0."""
        index = _observation_of(question)
        low, high = (float(own[index]) for own in self._ends)
        if not (region.lower[index] < low or region.upper[index] > high):
            return found
        misses = region.upper[index] < low or region.lower[index] > high
        if not misses and found.reached >= 0.0:
            return found
        witness = found.witness.copy()
        below = region.lower[index] < low
        witness[index] = (region.lower if below else region.upper)[index]
        return replace(
            found, bound=0.0 if misses else max(0.0, found.bound), reached=0.0, witness=witness
        )

    def _beyond(self, question: BoundQuery, region: Box) -> float:
        """Bounds how much further than it is read a joint's angle is, the way that is asked.

        An offset is a target less the angle itself, which no range holds back.
        """
        if question.of != "offset":
            return 0.0
        angle, (low, high) = self._positions[question.joint], self._ends
        below, above = low - region.lower, region.upper - high
        return max(0.0, float((below if question.sign > 0 else above)[angle]))

    def _image(self, state: int, joint: int, reflection: Reflection) -> Polynomial:
        """Returns what a joint's target is in the mirror of observations, multiplied out."""
        seen = [variable(index) for index in reflection.index.tolist()]
        images = {
            index: image if sign > 0.0 else Expression("neg", (image,))
            for index, (image, sign) in enumerate(zip(seen, reflection.sign, strict=True))
        }
        mirrored = self._formulas[state][joint].replaced(images)
        sign = Fraction(int(REFLECT_JOINTS.sign[joint]))
        return combined(self._ring.polynomial(mirrored), factor=sign)

    def change(self, state: int, joint: int, index: int, most: float, region: Box) -> float:
        """Bounds the change by the slope, which is bounded at once and not by search."""
        steepest = 0.0
        for sign in (1, -1):
            question = BoundQuery("slope", state, joint, sign, index)
            relaxation = Relaxation(self._ring, self._polynomial(question))
            read = self._read(region)
            bound = relaxation.upper(read.lower[None], read.upper[None])
            steepest = max(steepest, float(bound[0]))
        return most * steepest

    def _of(self, question: BoundQuery) -> Polynomial:
        polynomial = self._ring.polynomial(self._asked(question))
        return combined(polynomial, factor=Fraction(question.sign))

    def _asked(self, question: BoundQuery) -> Expression:
        formula = self._formulas[question.state][question.joint]
        match question.of:
            case "target":
                return formula
            case "offset":
                return Expression("sub", (formula, variable(self._positions[question.joint])))
            case "slope":
                return formula.derivative(_observation_of(question))
            case "effect":
                other = formula.replaced({_observation_of(question): variable(self._n)})
                return Expression("sub", (formula, other))


def _n_states(names: Sequence[str]) -> int:
    return max(1, len(indices_of("machine state", names)))


def _observation_of(question: BoundQuery) -> int:
    if question.observation is None:
        raise AssertionError(f"{question.of} asks for an observation")
    return question.observation


def _weighted_sum(weights: Array, intercept: float, units: RobotUnits, joint: int) -> Expression:
    """Writes a joint's target; products of numbers stay apart, so that nothing is rounded."""
    whole = constant(float(intercept))
    for index in np.flatnonzero(weights).tolist():
        weight = float(weights[index])
        deviation = Expression("sub", (variable(index), constant(float(units.offset[index]))))
        scaled = Expression("mul", (constant(float(units.scale[index])), deviation))
        whole = Expression("add", (whole, Expression("mul", (constant(weight), scaled))))
    action = Expression("mul", (constant(units.robot.action_scale), whole))
    return Expression("add", (constant(float(units.robot.default_stance[joint])), action))
