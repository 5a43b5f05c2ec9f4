"""Symbolic policies: one formula a joint, or one a joint and state of the reward machine."""

import copy
import hashlib
import json
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from functools import cached_property, reduce
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
    """A policy that is made of formulas, the same ones always or others in each machine state.

    A formula gives a joint's target in rad, from quantities in the robot's units. Its file is text:
    see `glassgait.models.formulas.file`.

    Attributes:
        expressions: Formulas (12), or (n_states, 12), in canonical form.
        vocabulary: What their variables are.
        mirror: State that each state is in the mirror, where the file leaves mirror images out.
        readings: In which ranges the formulas read what is sensed; none where in any.
    """

    dims: ClassVar[tuple[str, ...]]
    """Dimensions of `expressions`."""
    suffix = SUFFIX

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
            shape = self._refuse_other_shape(expressions)
            self._refuse_unfit(expressions, shape)
            self.expressions = _nested(canonical, expressions)
            # A sign that has moved may stand one deeper.
            self._refuse_unfit(self.expressions, shape)
            self.mirror = None if mirror is None else self._refuse_other_states(mirror)
            self._take(readings)
        self._units = RobotUnits.of(self.robot, self.observation_names)
        self._tapes = [self._targets(formulas) for formulas in self.formulas_by_state]

    @property
    @abstractmethod
    def formulas_by_state(self) -> tuple[tuple[Expression, ...], ...]:
        """Formulas of each state of the machine; a single row where all states share them."""

    def factored_terms(self, joint: int) -> tuple[FactoredTerm, ...]:
        by_state = self.formulas_by_state
        return tuple(
            _factored(term, state if len(by_state) > 1 else None)
            for state, formulas in enumerate(by_state)
            for term in formulas[joint].terms()
        )

    def importance(self, observations: Array) -> tuple[str, Array]:
        slopes = np.abs(self.derivatives(observations)).mean(axis=0)
        return "derivatives", slopes * observations.std(axis=0)

    @abstractmethod
    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivative of each action by each observation (..., 12, n)."""

    def quantities(self, observation: Array) -> Array:
        """Evaluates all variables of the formulas (..., k) where a robot observes (..., n)."""
        read = self._read(observation)
        return np.concatenate([read, self._defined(read)], axis=-1)

    def with_readings(self, readings: Readings | None) -> Self:
        """Returns the policy that reads what is sensed in these ranges.

        Raises:
            InputError: if they are not of what the policy observes.
        """
        own = copy.copy(self)
        with self._naming_this_kind():
            own._take(readings)
        return own

    def with_machine(self, gait: Gait) -> Self:
        """Returns the policy that holds its gait, and refuses to act in another.

        Raises:
            InputError: if the gait is another one than the policy's, or has other states.
        """
        self.check(
            gait=gait, observation_names=ObservationLayout(gait.n_states, imu=self.layout.imu).names
        )
        own = copy.copy(self)
        own.machine = gait
        return own

    def refuse_other_machine(self, gait: Gait) -> None:
        """Refuses another machine, and one that is not in the mirror what the policy says.

        Raises:
            InputError: if it is; the message names the key.
        """
        super().refuse_other_machine(gait)
        refuse_other_mirror(self.mirror, gait)

    def _take(self, readings: Readings | None) -> None:
        if readings is not None:
            readings.refuse_others(self.observation_names)
        self.readings = readings
        self._ends = None if readings is None else readings.ends(self.observation_names)

    def _read(self, observation: Array) -> Array:
        """Returns the quantities (..., n) that formulas read where a robot observes (..., n)."""
        quantities = self._units.quantities(observation)
        return quantities if self._ends is None else np.clip(quantities, *self._ends)

    @cached_property
    def _defined(self) -> Tape:
        formulas = [definition.formula for definition in self.vocabulary.definitions]
        return Tape(formulas, len(self.observation_names))

    def n_terms(self) -> int:
        """Counts the terms of all formulas that the policy's file holds."""
        return sum(len(formula.terms()) for formula in self.to_file().written().values())

    def to_file(self) -> FormulaFile:
        """Returns what the policy's file says."""
        shape = self._refuse_other_shape(self.expressions)
        formulas = {
            place: reduce(lambda entries, index: entries[index], place, self.expressions)
            for place in np.ndindex(*shape)
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

    def to_text(self) -> str:
        """Writes the policy as text, from which `from_file` builds the same policy.

        Raises:
            InputError: if the observations are not those of the task.
        """
        return write_formulas(self.to_file())

    @staticmethod
    def from_file(file: FormulaFile, robot: Robot | None = None) -> "FormulaPolicy":
        """Builds the policy that a file holds, of the robot that it names.

        It has an estimator of its own where the file holds odometry.

        Args:
            robot: That robot, where it does not ship.
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

    def save(self, path: Path) -> None:
        """Writes the policy's text to a file, atomically.

        Raises:
            InputError: if the observations are not those of the task.
        """
        write_atomically(path, self.to_text())

    def digest(self) -> str:
        symbols = self.vocabulary.symbols
        definitions = [
            [definition.symbol, write_formula(definition.formula, symbols)]
            for definition in self.vocabulary.definitions
        ]
        formulas = _nested(lambda formula: write_formula(formula, symbols), self.expressions)
        own = [*self._named(), self.observation_names, definitions, formulas]
        if self.joint_law.limited:
            own.append("limited")
        if self.joint_law.gains is not None:
            own.append(list(self.joint_law.gains))
        if self.joint_law.limits is not None:
            own.append(asdict(self.joint_law.limits))
        if self._odometry is not None:
            own.append(self._odometry.digest())
        if self.readings is not None:
            own.append(list(self.readings.ranges))
        if self.machine is not None:
            own.append(self.machine.digest())
        return hashlib.sha256(json.dumps(own).encode()).hexdigest()[:16]

    def _refuse_unfit(self, expressions: Any, shape: Sequence[int]) -> None:
        for place in np.ndindex(*shape):
            formula: Any = reduce(lambda entries, index: entries[index], place, expressions)
            with _naming_the_formula(place):
                refuse_unfit(formula, len(self.vocabulary.symbols))

    def _targets(self, formulas: Sequence[Expression]) -> Tape:
        """Compiles formulas of the observed quantities."""
        expanded = [self.vocabulary.expanded(formula) for formula in formulas]
        return Tape(expanded, len(self.observation_names))

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
            # Beyond its range a reading moves nothing.
            quantities, (low, high) = self._units.quantities(observation), self._ends
            derivatives *= ((quantities >= low) & (quantities <= high))[..., None, :]
        return derivatives / (self.robot.action_scale * self._units.scale)

    def _refuse_other_states(self, mirror: Sequence[int]) -> tuple[int, ...]:
        """Returns the states in the mirror, and refuses what is not its own mirror image."""
        states = range(self._sizes(self.observation_names)["states"])
        if sorted(mirror) != [*states] or any(mirror[mirror[s]] != s for s in states):
            raise InputError(f"its mirror is {tuple(mirror)}; it must name each state's image")
        return tuple(mirror)

    def _refuse_other_shape(self, entries: Any) -> list[int]:
        """Returns the shape that `expressions` have, and refuses entries of any other."""
        sizes = self._sizes(self.observation_names)
        shape = [sizes[dim] for dim in self.dims]
        if not _has_shape(entries, shape, Expression):
            wanted = ", ".join(f"{size} {dim}" for size, dim in zip(shape, self.dims, strict=True))
            raise InputError(f"its formulas must be lists of ({wanted}); fit them again")
        return shape


class SymbolicPolicy(FormulaPolicy):
    """Each target is a formula of what the robot senses.

    Attributes:
        expressions: Formulas, one a joint.
    """

    kind = "symbolic"
    dims = ("joints",)

    def __call__(self, observation: Array) -> Array:
        return actions_of(self.robot, self._tapes[0](self._read(observation)))

    @property
    def formulas_by_state(self) -> tuple[tuple[Expression, ...], ...]:
        return (self.expressions,)

    def _explain(self, observation: Array, joint: int) -> Contributions:
        return self._contributions(self.expressions[joint], observation)

    def derivatives(self, observation: Array) -> Array:
        return self._derivatives(self.expressions, observation)


class StatewiseSymbolicPolicy(FormulaPolicy):
    """A formula for each joint and state of the reward machine: a hybrid automaton to read.

    Attributes:
        expressions: Formulas (n_states, 12).
    """

    kind = "statewise_symbolic"
    dims = ("states", "joints")
    needed_groups = ("machine state",)

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

    @property
    def formulas_by_state(self) -> tuple[tuple[Expression, ...], ...]:
        return self.expressions

    def _explain(self, observation: Array, joint: int) -> Contributions:
        """Splits a joint's targets into contributions; those of other states' terms are 0."""
        state, terms, values = self.machine_state(observation), [], []
        for index, formulas in enumerate(self.expressions):
            own = self._contributions(formulas[joint], observation)
            terms += [f"state {index}: {term}" for term in own.terms]
            # Where the robot is in another state, this state's formula may not even be finite.
            values.append(np.where((state == index)[..., None], own.values, 0.0))
        return Contributions(tuple(terms), np.concatenate(values, axis=-1))

    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivative of each action by each observation (..., 12, n).

        The machine's state is held: at its change the formulas jump.
        """
        every_state = np.stack([self._derivatives(own, observation) for own in self.expressions])
        state = self.machine_state(observation)
        return np.take_along_axis(every_state, state[None, ..., None, None], axis=0)[0]


def _nested(function: Callable[[Any], Any], entries: Any) -> Any:
    if isinstance(entries, list | tuple):
        return tuple(_nested(function, entry) for entry in entries)
    return function(entries)


def _has_shape(entries: Any, shape: Sequence[int], kind: type) -> bool:
    if not shape:
        return isinstance(entries, kind)
    return (
        isinstance(entries, list | tuple)
        and len(entries) == shape[0]
        and all(_has_shape(entry, shape[1:], kind) for entry in entries)
    )


@contextmanager
def _naming_the_formula(place: Sequence[int]) -> Iterator[None]:
    """Puts the joint, and the state where it counts, before what is wrong with a formula."""
    try:
        yield
    except InputError as error:
        state = f" in state {place[0]}" if len(place) > 1 else ""
        raise InputError(f"{quadruped.JOINTS[place[-1]]}{state}: {error}") from error
