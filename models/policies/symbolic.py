"""Symbolic policies: one formula a joint, or one a joint and state of the reward machine."""

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import reduce
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.arrays import refuse_other_arrays
from glassgait.models.policies.expression import Expression
from glassgait.models.policies.expression_text import (
    parse_expression,
    refuse_unfit,
    variable_names,
)
from glassgait.models.policies.gates import named_gates
from glassgait.models.policies.policy import Contributions, Policy
from glassgait.models.policies.tape import Tape
from glassgait.models.task.observation import machine_state_entries

TERM_DIGITS = 3
"""Digits of the constants in the terms that an action is split into."""


class FormulaPolicy(Policy):
    """A policy that is made of formulas, the same ones always or others in each machine state.

    Attributes:
        expressions: Formulas (12), or (n_states, 12).
    """

    dims: ClassVar[tuple[str, ...]]
    """Dimensions of `expressions`."""
    # The gates that formulas are written with are functions of these.
    needed_groups = ("iterations", "foot height")

    def __init__(
        self, gait: str, observation_names: tuple[str, ...], expressions: Sequence[Any]
    ) -> None:
        super().__init__(gait, observation_names)
        with self._naming_this_kind():
            shape = self._refuse_other_shape(expressions, Expression, self.observation_names)
            for place in np.ndindex(*shape):
                formula: Any = reduce(lambda entries, index: entries[index], place, expressions)
                with _naming_the_formula(place):
                    refuse_unfit(formula, len(self.observation_names))
        self.expressions = _nested(lambda formula: formula, expressions)

    @property
    @abstractmethod
    def formulas_by_state(self) -> tuple[tuple[Expression, ...], ...]:
        """Formulas of each state of the machine; a single row where all states share them."""

    @abstractmethod
    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivative of each action by each observation (..., 12, n)."""

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        names = variable_names(len(self.observation_names))
        return {}, {"formulas": _nested(lambda f: f.to_text(names), self.expressions)}

    @classmethod
    def from_arrays(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        arrays: Mapping[str, NDArray[Any]],
        values: Mapping[str, Any],
    ) -> Self:
        names, texts = variable_names(len(observation_names)), values.get("formulas")
        with cls._naming_this_kind():
            refuse_other_arrays(arrays, cls.array_specs)
            cls._refuse_other_shape(texts, str, observation_names)
            formulas = _nested(lambda text: parse_expression(text, names), texts)
        return cls(gait, observation_names, expressions=formulas)

    @classmethod
    def _refuse_other_shape(
        cls, entries: Any, kind: type, observation_names: tuple[str, ...]
    ) -> list[int]:
        """Returns the shape that `expressions` have, and refuses entries of any other."""
        sizes = cls._sizes(observation_names)
        shape = [sizes[dim] for dim in cls.dims]
        if not _has_shape(entries, shape, kind):
            wanted = ", ".join(f"{size} {dim}" for size, dim in zip(shape, cls.dims, strict=True))
            raise InputError(f"its formulas must be lists of ({wanted}); fit them again")
        return shape


class SymbolicPolicy(FormulaPolicy):
    """Each action is a formula of the observations.

    Attributes:
        expressions: Formulas, one a joint.
    """

    kind = "symbolic"
    dims = ("joints",)

    def __init__(
        self, gait: str, observation_names: tuple[str, ...], expressions: Sequence[Expression]
    ) -> None:
        super().__init__(gait, observation_names, expressions)
        self._tape = Tape(self.expressions, len(observation_names))

    def __call__(self, observation: Array) -> Array:
        return self._tape(observation)

    @property
    def formulas_by_state(self) -> tuple[tuple[Expression, ...], ...]:
        return (self.expressions,)

    def _explain(self, observation: Array, joint: int) -> Contributions:
        return _contributions(self.expressions[joint], observation, self.observation_names)

    def derivatives(self, observation: Array) -> Array:
        return _derivatives(self.expressions, observation)


class StatewiseSymbolicPolicy(FormulaPolicy):
    """A formula for each joint and state of the reward machine: a hybrid automaton to read.

    Attributes:
        expressions: Formulas (n_states, 12).
    """

    kind = "statewise_symbolic"
    dims = ("states", "joints")
    needed_groups = ("machine state", *FormulaPolicy.needed_groups)

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        expressions: Sequence[Sequence[Expression]],
    ) -> None:
        super().__init__(gait, observation_names, expressions)
        self._one_hot = machine_state_entries(observation_names)
        self._tapes = [Tape(formulas, len(observation_names)) for formulas in self.expressions]

    def __call__(self, observation: Array) -> Array:
        if observation.ndim == 1:
            return self._tapes[int(np.argmax(observation[self._one_hot]))](observation)
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        action = np.empty((*state.shape, len(self.expressions[0])))
        for index, tape in enumerate(self._tapes):
            mine = state == index
            if mine.any():
                action[mine] = tape(observation[mine])
        return action

    @property
    def formulas_by_state(self) -> tuple[tuple[Expression, ...], ...]:
        return self.expressions

    def _explain(self, observation: Array, joint: int) -> Contributions:
        """Splits a joint's actions into contributions; those of other states' terms are 0."""
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        terms, values = [], []
        for index, formulas in enumerate(self.expressions):
            own = _contributions(formulas[joint], observation, self.observation_names)
            terms += [f"state {index}: {term}" for term in own.terms]
            # Where the robot is in another state, this state's formula may not even be finite.
            values.append(np.where((state == index)[..., None], own.values, 0.0))
        return Contributions(tuple(terms), np.concatenate(values, axis=-1))

    def derivatives(self, observation: Array) -> Array:
        """Evaluates the partial derivative of each action by each observation (..., 12, n).

        The machine's state is held: at its change the formulas jump.
        """
        every_state = np.stack([_derivatives(own, observation) for own in self.expressions])
        state = np.argmax(observation[..., self._one_hot], axis=-1)
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
        raise InputError(f"{robot.JOINTS[place[-1]]}{state}: {error}") from error


def _contributions(
    formula: Expression, observation: Array, names: tuple[str, ...]
) -> Contributions:
    terms = formula.terms()
    values = Tape(terms, len(names))(observation)
    gates = {gate: title for title, gate in named_gates(names).items()}
    # Terms of one product share their factors.
    titles: dict[int, str] = {}
    for term in terms:
        for factor in _factors(term):
            if id(factor) not in titles:
                titles[id(factor)] = gates.get(factor) or factor.to_text(names, TERM_DIGITS)
    return Contributions(tuple(_title(term, titles) for term in terms), values)


def _title(term: Expression, titles: Mapping[int, str]) -> str:
    # Weight and observation first: what they are gated by may be long.
    rank = {"constant": 0, "variable": 1}
    factors = sorted(_factors(term), key=lambda factor: rank.get(factor.operator, 2))
    return " * ".join(titles[id(factor)] for factor in factors).replace("+ -", "- ")


def _factors(term: Expression) -> list[Expression]:
    if term.operator != "mul":
        return [term]
    return [factor for operand in term.operands for factor in _factors(operand)]


def _derivatives(formulas: Sequence[Expression], observation: Array) -> Array:
    n = observation.shape[-1]
    slopes = [
        (joint, variable, formula.derivative(variable))
        for joint, formula in enumerate(formulas)
        for variable in sorted(formula.variables)
    ]
    derivatives = np.zeros((*observation.shape[:-1], len(formulas), n))
    if slopes:
        joints, variables, expressions = zip(*slopes, strict=True)
        derivatives[..., list(joints), list(variables)] = Tape(expressions, n)(observation)
    return derivatives
