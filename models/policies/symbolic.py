"""Symbolic policies: one formula a joint, or one a joint and state of the reward machine."""

import copy
import hashlib
import json
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import write_atomically
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import Expression, canonical, constant, refuse_unfit
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


def _factored(term: Expression, state: int | None) -> FactoredTerm:
    weight, quantities = 1.0, []
    for factor in factors_of(term):
        if factor.operator == "constant":
            weight *= factor.value
        else:
            quantities.append(factor)
    # Variables first: functions of them may be long.
    quantities.sort(key=lambda quantity: quantity.operator != "variable")
    return FactoredTerm((weight,), tuple(quantities), state)


def factors_of(term: Expression) -> tuple[Expression, ...]:
    """Splits a term into the factors whose product it is; a sign is the factor -1."""
    match term:
        case Expression("mul", (left, right)):
            return factors_of(left) + factors_of(right)
        case Expression("neg", (inner,)):
            return (constant(-1.0), *factors_of(inner))
        case _:
            return (term,)


class FormulaPolicy(Policy):
    """A policy that is made of formulas, the same ones always or others in each RM state.

    A formula gives a joint's target in rad, from quantities in the robot's units. Its file is text;
    see `glassgait.models.formulas.file`.

    Attributes:
        expressions: Formulas (12), or (n_states, 12), in canonical form.
        formulas_by_state: The same (n_states, 12), or (1, 12) where all states share them.
        vocabulary: The meaning of their variables.
        mirror: Mirror image of each RM state, where the file leaves mirror images out.
        readings: Ranges within which the formulas read sensors, if there are any.
    """

    suffix = SUFFIX
    statewise: ClassVar[bool]
    """Whether each RM state has its formulas."""

    expressions: Any

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        expressions: Sequence[Any],
        *,
        definitions: Sequence[Definition] = (),
        mirror: Sequence[int] | None = None,
        readings: Readings | None = None,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(gait, observation_names, robot=robot)
        self.vocabulary = Vocabulary(self.observation_names, tuple(definitions))
        with self._naming_this_kind():
            given = self._rows(expressions)
            self._refuse_unfit(given)
            rows = tuple(tuple(canonical(formula) for formula in row) for row in given)
            # A sign that has moved may stand one deeper.
            self._refuse_unfit(rows)
            self.mirror = None if mirror is None else self._checked_mirror(mirror)
            self._take(readings)
        self.formulas_by_state: tuple[tuple[Expression, ...], ...] = rows
        self.expressions = rows if self.statewise else rows[0]
        self._units = RobotUnits.of(self.robot, self.observation_names)
        self._tapes = [self._targets(formulas) for formulas in rows]

    def _rows(self, expressions: Any) -> Sequence[Sequence[Expression]]:
        """Returns the formulas by RM state, and refuses another shape."""
        count = self.layout.n_machine_states if self.statewise else 1
        rows = expressions if self.statewise else (expressions,)
        fits = len(rows) == count and all(
            isinstance(row, list | tuple)
            and len(row) == quadruped.N_JOINTS
            and all(isinstance(formula, Expression) for formula in row)
            for row in rows
        )
        if not fits:
            raise InputError(
                f"its formulas must be {quadruped.N_JOINTS}"
                f"{f' for each of {count} states' if self.statewise else ''}; fit them again"
            )
        return rows

    def _refuse_unfit(self, rows: Sequence[Sequence[Expression]]) -> None:
        for state, row in enumerate(rows):
            for joint, formula in zip(quadruped.JOINTS, row, strict=True):
                try:
                    refuse_unfit(formula, len(self.vocabulary.symbols))
                except InputError as error:
                    place = f"{joint} in state {state}" if self.statewise else joint
                    raise InputError(f"{place}: {error}") from error

    def _checked_mirror(self, mirror: Sequence[int]) -> tuple[int, ...]:
        states = range(self.layout.n_machine_states)
        if sorted(mirror) != [*states] or any(mirror[mirror[s]] != s for s in states):
            raise InputError(f"its mirror is {tuple(mirror)}; it must name each state's image")
        return tuple(mirror)

    def _take(self, readings: Readings | None) -> None:
        if readings is not None:
            readings.refuse_others(self.observation_names)
        self.readings = readings
        self._ends = None if readings is None else readings.ends(self.observation_names)

    def with_readings(self, readings: Readings | None) -> Self:
        """Returns the policy that reads sensors within these ranges.

        Raises:
            InputError: if they are not of its observations.
        """
        made = copy.copy(self)
        with self._naming_this_kind():
            made._take(readings)
        return made

    def with_machine(self, gait: Gait) -> Self:
        """Returns the policy that holds its gait, and refuses to act in another.

        Raises:
            InputError: if the gait is another one than the policy's, or has other states.
        """
        names = ObservationLayout(gait.n_states, imu=self.layout.imu).names
        self.check(gait=gait, observation_names=names)
        made = copy.copy(self)
        made.machine = gait
        return made

    def refuse_other_machine(self, gait: Gait) -> None:
        """Refuses another machine, and one whose mirror images are not the policy's.

        Raises:
            InputError: if it is; the message names the key.
        """
        super().refuse_other_machine(gait)
        refuse_other_mirror(self.mirror, gait)

    # ---- Files -------------------------------------------------------------------------------

    def to_file(self) -> FormulaFile:
        """Returns the content of the policy's file."""
        formulas: dict[tuple[int, ...], Expression] = {}
        for state, row in enumerate(self.formulas_by_state):
            for joint, formula in enumerate(row):
                formulas[(state, joint) if self.statewise else (joint,)] = formula
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
        """Counts the terms of all formulas in the policy's file."""
        return sum(len(formula.terms()) for formula in self.to_file().written().values())

    def to_text(self) -> str:
        """Writes the policy as text, from which `from_file` builds the same policy."""
        return write_formulas(self.to_file())

    def save(self, path: Path) -> None:
        """Writes the policy's text to a file, atomically."""
        write_atomically(path, self.to_text())

    @staticmethod
    def from_file(file: FormulaFile, robot: Robot | None = None) -> "FormulaPolicy":
        """Builds the policy of a file, with its estimator if the file holds odometry.

        Args:
            file: The content of the file.
            robot: The robot that the file names; by default the shipped one.
        """
        kind: type[FormulaPolicy] = SymbolicPolicy
        expressions: Any = tuple(file.formulas.values())
        if file.n_states is not None:
            kind, joints = StatewiseSymbolicPolicy, quadruped.N_JOINTS
            starts = range(0, len(expressions), joints)
            expressions = tuple(expressions[start : start + joints] for start in starts)
        policy = kind(
            file.gait,
            file.vocabulary.names,
            expressions,
            definitions=file.vocabulary.definitions,
            mirror=file.mirror,
            readings=file.readings,
            robot=robot or load_robot(file.robot),
        )
        policy._estimator, policy.machine = file.odometry, file.machine
        return policy.with_joint_law(file.joint_law)

    def digest(self) -> str:
        symbols, law = self.vocabulary.symbols, self.joint_law
        definitions = [
            [definition.symbol, write_formula(definition.formula, symbols)]
            for definition in self.vocabulary.definitions
        ]
        rows = [[write_formula(one, symbols) for one in row] for row in self.formulas_by_state]
        parts: list[Any] = [*self._named(), self.observation_names, definitions]
        parts.append(rows if self.statewise else rows[0])
        parts += ["limited"] if law.limited else []
        parts += [] if law.gains is None else [list(law.gains)]
        parts += [] if law.limits is None else [asdict(law.limits)]
        parts += [] if self._odometry is None else [self._odometry.digest()]
        parts += [] if self.readings is None else [list(self.readings.ranges)]
        parts += [] if self.machine is None else [self.machine.digest()]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]

    # ---- Evaluation --------------------------------------------------------------------------

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
        """Compiles formulas of the observed quantities."""
        expanded = [self.vocabulary.expanded(formula) for formula in formulas]
        return Tape(expanded, len(self.observation_names))

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        return tuple(
            _factored(term, state if self.statewise else None)
            for state, formulas in enumerate(self.formulas_by_state)
            for term in formulas[joint].terms()
        )

    def importance(self, observations: Array) -> tuple[str, Array]:
        slopes = np.abs(self.derivatives(observations)).mean(axis=0)
        return "derivatives", slopes * observations.std(axis=0)

    @abstractmethod
    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivative of each action by each observation (..., 12, n)."""

    def _contributions(self, formula: Expression, observation: Array) -> Contributions:
        terms = [canonical(term) for term in formula.terms()]
        values = self._targets(terms)(self._read(observation))
        symbols = self.vocabulary.symbols
        return Contributions(tuple(write_formula(term, symbols) for term in terms), values)

    def _derivatives(self, formulas: Sequence[Expression], observation: Array) -> Array:
        n = observation.shape[-1]
        expanded = [self.vocabulary.expanded(formula) for formula in formulas]
        slopes = [
            (joint, variable, formula.derivative(variable))
            for joint, formula in enumerate(expanded)
            for variable in sorted(formula.variables)
        ]
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


class SymbolicPolicy(FormulaPolicy):
    """Each target is a formula of the observed quantities.

    Attributes:
        expressions: Formulas, one a joint.
    """

    kind = "symbolic"
    statewise = False

    def __call__(self, observation: Array) -> Array:
        return actions_of(self.robot, self._tapes[0](self._read(observation)))

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        return self._contributions(self.expressions[quadruped.joint_index(joint)], observation)

    def derivatives(self, observation: Array) -> Array:
        return self._derivatives(self.expressions, observation)


class StatewiseSymbolicPolicy(FormulaPolicy):
    """A formula for each joint and RM state: a hybrid automaton to read.

    Attributes:
        expressions: Formulas (n_states, 12).
    """

    kind = "statewise_symbolic"
    statewise = True

    def __call__(self, observation: Array) -> Array:
        quantities, states = self._read(observation), self.machine_state(observation)
        if observation.ndim == 1:
            return actions_of(self.robot, self._tapes[int(states)](quantities))
        targets = np.empty((*states.shape, quadruped.N_JOINTS))
        for index, tape in enumerate(self._tapes):
            mine = states == index
            if mine.any():
                targets[mine] = tape(quantities[mine])
        return actions_of(self.robot, targets)

    def explain(self, observation: Array, joint: int | str) -> Contributions:
        """Splits a joint's targets into contributions; those of other states' terms are 0."""
        joint = quadruped.joint_index(joint)
        state, terms, values = self.machine_state(observation), [], []
        for index, formulas in enumerate(self.expressions):
            found = self._contributions(formulas[joint], observation)
            terms += [f"state {index}: {term}" for term in found.terms]
            # Where the robot is in another state, this state's formula may not even be finite.
            values.append(np.where((state == index)[..., None], found.values, 0.0))
        return Contributions(tuple(terms), np.concatenate(values, axis=-1))

    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivative of each action by each observation (..., 12, n).

        The RM state is held: at its change the formulas jump.
        """
        every_state = np.stack([self._derivatives(row, observation) for row in self.expressions])
        state = self.machine_state(observation)
        return np.take_along_axis(every_state, state[None, ..., None, None], axis=0)[0]
