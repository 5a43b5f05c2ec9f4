"""Bounds of targets that are formulas."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np

from glassgait.models.certificates.maximum import maximize
from glassgait.models.certificates.question import BoundQuery, Box, Maximum, with_copy
from glassgait.models.certificates.relaxation import Relaxation
from glassgait.models.certificates.rounding import formula_error
from glassgait.models.formulas.expression import Expression, variable
from glassgait.models.formulas.polynomial import (
    Polynomial,
    PolynomialRing,
    combined,
)
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, Reflection, reflect_observation


class FormulaTargets:
    """Bounds of the targets that a policy's formulas give."""

    def __init__(self, policy: FormulaPolicy) -> None:
        """
        Args:
            policy: The policy.
        """
        self._names = names = policy.observation_names
        self._units = RobotUnits.of(policy.robot, names)
        rows = [
            [policy.vocabulary.expanded(formula) for formula in row]
            for row in policy.formulas_by_state
        ]
        n_states = max(1, len(indices_of("machine state", names)))
        self._formulas = rows if len(rows) > 1 else rows * n_states
        self._n = len(names)
        self._positions = indices_of("joint position", names)
        whole = np.full(self._n, np.inf)
        readings = policy.readings
        self._ends = (-whole, whole) if readings is None else readings.ends(names)
        self._ring = PolynomialRing()
        # The machine's state is held, so formulas that serve all states lose some of their parts.
        self._polynomial = cache(self._of)

    def used(self, state: int, joint: int) -> frozenset[int]:
        """Returns the quantities that a target is written with, also those that cancel out."""
        return self._formulas[state][joint].variables

    def rounding(self, state: int, joint: int, region: Box) -> float:
        """Bounds how far a target in double precision may be from the exact one (rad).

        Raises:
            InputError: if that is too far, or the target may have no value in the box.
        """
        return formula_error(self._formulas[state][joint], joint, self._read(region), self._units)

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
        """Bounds what is asked, times its sign, over a box.

        Args:
            question: What is asked.
            region: The box, in the robot's units, with the machine's state held. The witness of an
                effect ends with the other value of its observation (n + 1).
            gap: Distance of bound and witness that is near enough (rad).
            threshold: A number of interest; see `maximize`.
        """
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
        """Bounds the change of a target (rad) where a quantity changes by `most` at most.

        The slope is bounded at once, without a search.
        """
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


def _observation_of(question: BoundQuery) -> int:
    if question.observation is None:
        raise AssertionError(f"{question.of} asks for an observation")
    return question.observation
