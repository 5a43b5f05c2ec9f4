"""Symbolic policies: one formula a joint, or one a joint and state of the reward machine."""

import copy
import hashlib
import json
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
    """A policy that is made of formulas, the same ones always or others in each RM state.

    A formula gives a joint's target in rad, from quantities in the robot's units.

    Attributes:
        formulas_by_state: Canonical formulas (n_states, 12), or (1, 12) for all states.
        mirror: Mirror image of each RM state, where the file leaves mirror images out.
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
            self._take(readings)
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

    def _take(self, readings: Readings | None) -> None:
        if readings is not None:
            readings.refuse_others(self.observation_names)
        self.readings = readings
        self._ends = None if readings is None else readings.ends(self.observation_names)

    def with_readings(self, readings: Readings | None) -> Self:
        made = copy.copy(self)
        with self._naming_this_kind():
            made._take(readings)
        return made

    def with_machine(self, gait: Gait) -> Self:
        """Returns the policy that holds its gait, and refuses to act in another."""
        names = ObservationLayout(gait.n_states, imu=self.layout.imu).names
        self.check(gait=gait, observation_names=names)
        made = copy.copy(self)
        made.machine = gait
        return made

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
        """Writes the policy as text, from which `from_file` builds the same policy."""
        return write_formulas(self.to_file())

    def save(self, path: str | Path) -> None:
        write_atomically(Path(path), self.to_text())

    @staticmethod
    def from_file(file: FormulaFile, robot: Robot | None = None) -> "FormulaPolicy":
        """Builds the policy of a file, with its estimator if the file holds odometry."""
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
        # The text of formulas, without notes, which move no joint.
        definitions = [
            [definition.symbol, write_formula(definition.formula, symbols)]
            for definition in self.vocabulary.definitions
        ]
        rows = [[write_formula(one, symbols) for one in row] for row in self.formulas_by_state]
        parts: list[Any] = [*self._named(), self.observation_names, definitions]
        parts.append(rows if self.per_state else rows[0])
        # A file's other keys count only where they are given.
        parts += ["limited"] if law.limited else []
        parts += [] if law.gains is None else [list(law.gains)]
        parts += [] if law.limits is None else [asdict(law.limits)]
        parts += [] if self._odometry is None else [self._odometry.digest()]
        parts += [] if self.readings is None else [list(self.readings.ranges)]
        parts += [] if self.machine is None else [self.machine.digest()]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    # ---- Evaluation --------------------------------------------------------------------------

    def act(self, observation: Array) -> Array:
        quantities, acting = self._read(observation), self._acting(observation)
        if observation.ndim == 1:
            return actions_of(self.robot, self._tapes[int(acting)](quantities))
        targets = np.empty((*acting.shape, quadruped.N_JOINTS))
        for index, tape in enumerate(self._tapes):
            mine = acting == index
            if mine.any():
                targets[mine] = tape(quantities[mine])
        return actions_of(self.robot, targets)

    def _acting(self, observation: Array) -> NDArray[np.intp]:
        if self.per_state:
            return self.machine_state(observation)
        return np.zeros(observation.shape[:-1], dtype=np.intp)

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        """Splits a joint's targets into contributions; terms of other RM states contribute 0."""
        joint, symbols = quadruped.joint_index(joint), self.vocabulary.symbols
        read, acting = self._read(observation), self._acting(observation)
        names, values = [], []
        for state, formulas in enumerate(self.formulas_by_state):
            terms = [canonical(term) for term in formulas[joint].terms()]
            title = f"state {state}: " if self.per_state else ""
            names += [title + write_formula(term, symbols) for term in terms]
            # Where the robot is in another state, this state's formula may not even be finite.
            mine = (acting == state)[..., None]
            values.append(np.where(mine, self._targets(terms)(read), 0.0))
        return Contributions(tuple(names), np.concatenate(values, axis=-1))

    def quantities(self, observation: Array) -> Array:
        """Evaluates all variables of the formulas (..., k) at observations (..., n)."""
        read = self._read(observation)
        return np.concatenate([read, self._defined(read)], axis=-1)

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
        """Evaluates the partial derivative of each action by each observation (..., 12, n).

        The RM state is held: at its change the formulas jump.
        """
        rows = np.stack([self._slopes(row, observation) for row in self.formulas_by_state])
        acting = self._acting(observation)[None, ..., None, None]
        return np.take_along_axis(rows, acting, axis=0)[0]

    def _slopes(self, formulas: Sequence[Expression], observation: Array) -> Array:
        # The slopes that are not 0 by themselves, as formulas.
        n = observation.shape[-1]
        expanded = [self.vocabulary.expanded(formula) for formula in formulas]
        slopes = [
            (joint, variable, formula.derivative(variable))
            for joint, formula in enumerate(expanded)
            for variable in sorted(formula.variables)
        ]

        # Their values, in a matrix of zeros.
        derivatives = np.zeros((*observation.shape[:-1], len(formulas), n))
        if slopes:
            joints, variables, expressions = zip(*slopes, strict=True)
            found = Tape(expressions, n)(self._read(observation))
            derivatives[..., list(joints), list(variables)] = found
        if self._ends is not None:
            # Beyond its range a reading has no effect.
            quantities, (low, high) = self._units.quantities(observation), self._ends
            derivatives *= ((quantities >= low) & (quantities <= high))[..., None, :]
        return derivatives / (self.robot.action_scale * self._units.scale)


def _factored(term: Expression, state: int | None) -> FactoredTerm:
    # The numbers among the factors make one weight.
    weight, quantities = 1.0, []
    for factor in _factors(term):
        if factor.operator == "constant":
            weight *= factor.value
        else:
            quantities.append(factor)
    # Variables first: functions of them may be long.
    quantities.sort(key=lambda quantity: quantity.operator != "variable")
    return FactoredTerm((weight,), tuple(quantities), state)


def _factors(term: Expression) -> tuple[Expression, ...]:
    """Splits a term into the factors whose product it is; a sign is the factor -1."""
    match term:
        case Expression("mul", (left, right)):
            return _factors(left) + _factors(right)
        case Expression("neg", (inner,)):
            return (constant(-1.0), *_factors(inner))
        case _:
            return (term,)


class SymbolicPolicy(FormulaPolicy):
    """Each target is a formula of the observed quantities."""

    kind = "symbolic"
    per_state = False


class SymbolicPerStatePolicy(FormulaPolicy):
    """A formula for each joint and RM state: a hybrid automaton to read."""

    kind = "symbolic_per_state"
    per_state = True
