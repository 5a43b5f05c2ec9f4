"""Symbolic policies: one formula per joint, or per joint and RM state."""

import copy
import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import write_atomically
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, canonical, checked_formula, constant
from glassgait.models.formulas.file import SUFFIX, FormulaFile, write_formulas
from glassgait.models.formulas.grammar import write_formula
from glassgait.models.formulas.quantities import (
    Definition,
    Readings,
    RobotUnits,
    Vocabulary,
    actions_of,
)
from glassgait.models.policies.policy import Contributions, FactoredTerm, Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import refuse_other_mirror


class FormulaPolicy(Policy):
    """A policy of formulas: one set for all RM states, or one set per state.

    A formula maps quantities in the robot's units to a joint's target in rad.

    Attributes:
        formulas_by_state: Canonical formulas (n_states, 12), or (1, 12) for all states.
        mirror: Mirror image of each RM state, if the file leaves out mirror images of formulas.
    """

    suffix = SUFFIX
    per_state: ClassVar[bool]

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        formulas_by_state: Sequence[Sequence[Expression]],
        *,
        definitions: Sequence[Definition] = (),
        mirror: Sequence[int] | None = None,
        readings: Readings | None = None,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(gait, observation_names, robot=robot)
        self.vocabulary = Vocabulary(self.observation_names, tuple(definitions))
        self.mirror = None if mirror is None else tuple(mirror)
        with self._naming_this_kind():
            self.formulas_by_state = self._canonical(formulas_by_state)
            self._set_readings(readings)
        self._units = RobotUnits.of(self.robot, self.observation_names)
        self._tapes = [self._targets(formulas) for formulas in self.formulas_by_state]

    def _canonical(
        self, rows: Sequence[Sequence[Expression]]
    ) -> tuple[tuple[Expression, ...], ...]:
        n_rows = self.layout.n_machine_states if self.per_state else 1
        if [len(row) for row in rows] != [quadruped.N_JOINTS] * n_rows:
            raise InputError(
                f"its formulas must be of shape ({n_rows}, {quadruped.N_JOINTS}); fit them again"
            )
        count = len(self.vocabulary.symbols)
        return tuple(tuple(checked_formula(formula, count) for formula in row) for row in rows)

    def _set_readings(self, readings: Readings | None) -> None:
        if readings is not None:
            readings.refuse_others(self.observation_names)
        self.readings = readings
        self._ends = None if readings is None else readings.ends(self.observation_names)

    def with_readings(self, readings: Readings | None) -> Self:
        policy = copy.copy(self)
        with self._naming_this_kind():
            policy._set_readings(readings)
        return policy

    def with_machine(self, gait: Gait) -> Self:
        """Returns the policy with its gait, which its file then contains; see `check`."""
        names = ObservationLayout(gait.n_states, imu=self.layout.imu).names
        self.check(gait=gait, observation_names=names)
        policy = copy.copy(self)
        policy.machine = gait
        return policy

    def refuse_other_machine(self, gait: Gait) -> None:
        super().refuse_other_machine(gait)
        refuse_other_mirror(self.mirror, gait)

    # ---- Files -------------------------------------------------------------------------------

    def to_file(self) -> FormulaFile:
        formulas = {
            ((state, joint) if self.per_state else (joint,)): formula
            for state, row in enumerate(self.formulas_by_state)
            for joint, formula in enumerate(row)
        }
        return FormulaFile(
            self.gait,
            self.vocabulary,
            formulas,
            self.mirror,
            self.joint_law,
            self.robot.name,
            self._odometry,
            self.readings,
            self.machine,
        )

    @property
    def _odometry(self) -> Odometry | None:
        return self._estimator if isinstance(self._estimator, Odometry) else None

    def n_terms(self) -> int:
        return sum(len(formula.terms()) for formula in self.to_file().written().values())

    def to_text(self) -> str:
        """Returns the text of the policy's formula file."""
        return write_formulas(self.to_file())

    def save(self, path: str | Path) -> None:
        write_atomically(Path(path), self.to_text())

    @staticmethod
    def from_file(file: FormulaFile, robot: Robot | None = None) -> "FormulaPolicy":
        """Builds a policy from a formula file, with an estimator if the file contains odometry."""
        kind = SymbolicPolicy if file.n_states is None else SymbolicPerStatePolicy
        formulas, joints = list(file.formulas.values()), quadruped.N_JOINTS
        policy = kind(
            file.gait,
            file.vocabulary.names,
            [formulas[start : start + joints] for start in range(0, len(formulas), joints)],
            definitions=file.vocabulary.definitions,
            mirror=file.mirror,
            readings=file.readings,
            robot=robot or load_robot(file.robot),
        )
        policy._estimator, policy.machine = file.odometry, file.machine
        return policy.with_joint_law(file.joint_law)

    def digest(self) -> str:
        symbols, law = self.vocabulary.symbols, self.joint_law
        # Notes of definitions are left out, since they do not affect actions.
        definitions = [
            [definition.symbol, write_formula(definition.formula, symbols)]
            for definition in self.vocabulary.definitions
        ]
        rows = [[write_formula(f, symbols) for f in row] for row in self.formulas_by_state]
        parts: list[Any] = [*self._named(), self.observation_names, definitions]
        parts.append(rows if self.per_state else rows[0])
        # A file's other keys count only if they are present.
        parts += ["limited"] if law.limited else []
        parts += [] if law.gains is None else [list(law.gains)]
        parts += [] if law.limits is None else [asdict(law.limits)]
        parts += [] if self._odometry is None else [self._odometry.digest()]
        parts += [] if self.readings is None else [list(self.readings.ranges)]
        parts += [] if self.machine is None else [self.machine.digest()]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    # ---- Evaluation --------------------------------------------------------------------------

    def act(self, observation: Array) -> Array:
        quantities, sets = self._read(observation), self._formula_set(observation)
        if observation.ndim == 1:
            return actions_of(self.robot, self._tapes[int(sets)](quantities))
        targets = np.empty((*sets.shape, quadruped.N_JOINTS))
        for index, tape in enumerate(self._tapes):
            in_state = sets == index
            if in_state.any():
                targets[in_state] = tape(quantities[in_state])
        return actions_of(self.robot, targets)

    def _formula_set(self, observation: Array) -> NDArray[np.intp]:
        if self.per_state:
            return self.machine_state(observation)
        return np.zeros(observation.shape[:-1], dtype=np.intp)

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        """Splits a joint's targets into contributions; terms of other RM states contribute 0."""
        joint, symbols = quadruped.joint_index(joint), self.vocabulary.symbols
        quantities, sets = self._read(observation), self._formula_set(observation)
        names, values = [], []
        for state, formulas in enumerate(self.formulas_by_state):
            terms = [canonical(term) for term in formulas[joint].terms()]
            title = f"state {state}: " if self.per_state else ""
            names += [title + write_formula(term, symbols) for term in terms]
            # In other states of the robot, this state's terms may not even be finite.
            in_state = (sets == state)[..., None]
            values.append(np.where(in_state, self._targets(terms)(quantities), 0.0))
        return Contributions(tuple(names), np.concatenate(values, axis=-1))

    def quantities(self, observation: Array) -> Array:
        """Evaluates all variables of the formulas (..., k) at observations (..., n)."""
        observed = self._read(observation)
        return np.concatenate([observed, self._defined(observed)], axis=-1)

    def _read(self, observation: Array) -> Array:
        """Returns the quantities (..., n) that formulas read at observations (..., n)."""
        quantities = self._units.quantities(observation)
        return quantities if self._ends is None else np.clip(quantities, *self._ends)

    @cached_property
    def _defined(self) -> Tape:
        formulas = [definition.formula for definition in self.vocabulary.definitions]
        return Tape(formulas, len(self.observation_names))

    def _targets(self, formulas: Sequence[Expression]) -> Tape:
        expanded = [self.vocabulary.expanded(formula) for formula in formulas]
        return Tape(expanded, len(self.observation_names))

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        return tuple(
            _factored(term, state if self.per_state else None)
            for state, formulas in enumerate(self.formulas_by_state)
            for term in formulas[joint].terms()
        )

    def importance(self, observations: Array) -> tuple[str, Array]:
        slopes = np.abs(self.derivatives(observations)).mean(axis=0)
        return "derivatives", slopes * observations.std(axis=0)

    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivatives of actions with respect to observations (..., 12, n).

        The RM state is held constant, since formulas are discontinuous where it changes.
        """
        rows = np.stack([self._slopes(row, observation) for row in self.formulas_by_state])
        sets = self._formula_set(observation)[None, ..., None, None]
        return np.take_along_axis(rows, sets, axis=0)[0]

    def _slopes(self, formulas: Sequence[Expression], observation: Array) -> Array:
        # Differentiate the formulas by each of their variables.
        n = observation.shape[-1]
        expanded = [self.vocabulary.expanded(formula) for formula in formulas]
        slopes = [
            (joint, variable, formula.derivative(variable))
            for joint, formula in enumerate(expanded)
            for variable in sorted(formula.variables)
        ]

        # Evaluate the slopes; all others are 0.
        derivatives = np.zeros((*observation.shape[:-1], len(formulas), n))
        if slopes:
            joints, variables, expressions = zip(*slopes, strict=True)
            values = Tape(expressions, n)(self._read(observation))
            derivatives[..., list(joints), list(variables)] = values
        if self._ends is not None:
            # Outside its range, a quantity has no effect.
            quantities, (low, high) = self._units.quantities(observation), self._ends
            derivatives *= ((quantities >= low) & (quantities <= high))[..., None, :]
        return derivatives / (self.robot.action_scale * self._units.scale)


def _factored(term: Expression, state: int | None) -> FactoredTerm:
    # Multiply the constant factors into one weight.
    factors = _factors(term)
    numbers = (factor.value for factor in factors if factor.operator == "constant")
    quantities = [factor for factor in factors if factor.operator != "constant"]
    # Variables first: functions of them may be long.
    quantities.sort(key=lambda quantity: quantity.operator != "variable")
    return FactoredTerm((math.prod(numbers, start=1.0),), tuple(quantities), state)


def _factors(term: Expression) -> tuple[Expression, ...]:
    """Splits a term into factors; a minus sign becomes the factor -1."""
    match term:
        case Expression("mul", (left, right)):
            return _factors(left) + _factors(right)
        case Expression("neg", (inner,)):
            return (constant(-1.0), *_factors(inner))
        case _:
            return (term,)


class SymbolicPolicy(FormulaPolicy):
    """Each joint has one formula for all RM states."""

    kind = "symbolic"
    per_state = False


class SymbolicPerStatePolicy(FormulaPolicy):
    """Each joint has one formula per RM state: a readable hybrid automaton."""

    kind = "symbolic_per_state"
    per_state = True
