"""Symbolic policies: one formula a joint, compiled and evaluated for all joints at once."""

from abc import abstractmethod
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from models.a1.robot import Array
from models.policies.expression import Expression, parse_expression, variable_names
from models.policies.gates import named_gates
from models.policies.policy import Contributions, Policy
from models.task.observation import machine_state_entries

TERM_DIGITS = 3
"""Digits of the constants in the terms that an action is split into."""

_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sin": np.sin,
    "cos": np.cos,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "square": np.square,
    "cube": lambda x: x * x * x,
}


@dataclass(frozen=True)
class _Instruction:
    """One operator, applied to all nodes of a height at once."""

    function: Callable[..., Array]
    operands: tuple[NDArray[np.intp], ...]
    start: int
    stop: int


class Tape:
    """Formulas compiled to a short list of vectorised instructions.

    Nodes of all formulas that have the same operator and the same height are evaluated together,
    and a sub-formula that occurs twice is evaluated once.
    """

    def __init__(self, expressions: Sequence[Expression], n_variables: int) -> None:
        self._n_variables = n_variables
        self._slots: dict[Any, int] = {}
        constants: list[float] = []
        by_height: dict[tuple[int, str], list[tuple]] = defaultdict(list)
        heights: dict[Any, int] = {}

        def visit(expression: Expression) -> Any:
            if expression.operator == "variable":
                return ("variable", expression.variable)
            if expression.operator == "constant":
                key = ("constant", expression.value)
                if key not in self._slots:
                    self._slots[key] = n_variables + len(constants)
                    constants.append(expression.value)
                return key
            operands = tuple(visit(operand) for operand in expression.operands)
            key = (expression.operator, operands)
            if key not in heights:
                heights[key] = 1 + max(heights.get(operand, 0) for operand in operands)
                by_height[heights[key], expression.operator].append(key)
            return key

        roots = [visit(expression) for expression in expressions]
        self._constants = np.array(constants)
        self._instructions: list[_Instruction] = []
        size = n_variables + len(constants)
        for (_, operator), keys in sorted(by_height.items(), key=lambda item: item[0]):
            operands = zip(*(key[1] for key in keys), strict=True)
            sources = tuple(np.array([self._slot(key) for key in side]) for side in operands)
            for offset, key in enumerate(keys):
                self._slots[key] = size + offset
            self._instructions.append(
                _Instruction(_FUNCTIONS[operator], sources, size, size + len(keys))
            )
            size += len(keys)
        self._size = size
        self._outputs = np.array([self._slot(root) for root in roots], dtype=np.int64)

    def __call__(self, observation: Array) -> Array:
        """Evaluates all formulas (..., k) on observations (..., n)."""
        # Nodes along the first axis, so that an instruction writes one block of memory.
        rows = observation.reshape(-1, self._n_variables)
        values = np.empty((self._size, len(rows)))
        values[: self._n_variables] = rows.T
        first = self._n_variables
        values[first : first + len(self._constants)] = self._constants[:, None]
        with np.errstate(all="ignore"):
            for step in self._instructions:
                operands = (values[operand] for operand in step.operands)
                values[step.start : step.stop] = step.function(*operands)
        return values[self._outputs].T.reshape(*observation.shape[:-1], len(self._outputs))

    def _slot(self, key: Any) -> int:
        return key[1] if key[0] == "variable" else self._slots[key]


class FormulaPolicy(Policy):
    """A policy that is made of formulas, the same ones always or others in each machine state.

    Attributes:
        expressions: Formulas (12), or (n_states, 12).
    """

    def __init__(
        self, gait: str, observation_names: tuple[str, ...], expressions: Sequence[Any]
    ) -> None:
        super().__init__(gait, observation_names)
        self.expressions = tuple(expressions)

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
        names = variable_names(len(observation_names))
        formulas = _nested(lambda text: parse_expression(text, names), values["formulas"])
        return cls(gait, observation_names, expressions=formulas)


class SymbolicPolicy(FormulaPolicy):
    """Each action is a formula of the observations.

    Attributes:
        expressions: Formulas, one a joint.
    """

    kind = "symbolic"

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

    def explain(self, observation: Array, joint: int) -> Contributions:
        return _contributions(self.expressions[joint], observation, self.observation_names)

    def derivatives(self, observation: Array) -> Array:
        return _derivatives(self.expressions, observation)


class StatewiseSymbolicPolicy(FormulaPolicy):
    """A formula for each joint and state of the reward machine: a hybrid automaton to read.

    Attributes:
        expressions: Formulas (n_states, 12).
    """

    kind = "statewise_symbolic"

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        expressions: Sequence[Sequence[Expression]],
    ) -> None:
        super().__init__(gait, observation_names, [tuple(formulas) for formulas in expressions])
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

    def explain(self, observation: Array, joint: int) -> Contributions:
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


def _contributions(
    formula: Expression, observation: Array, names: tuple[str, ...]
) -> Contributions:
    terms = formula.terms()
    values = Tape(terms, len(names))(observation)
    gates = {gate: title for title, gate in named_gates(names).items()}
    return Contributions(tuple(_title(term, names, gates) for term in terms), values)


def _title(term: Expression, names: tuple[str, ...], gates: Mapping[Expression, str]) -> str:
    # Weight and observation first: what they are gated by may be long.
    rank = {"constant": 0, "variable": 1}
    factors = sorted(_factors(term), key=lambda factor: rank.get(factor.operator, 2))
    texts = [gates.get(factor, factor.to_text(names, TERM_DIGITS)) for factor in factors]
    return " * ".join(texts).replace("+ -", "- ")


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
