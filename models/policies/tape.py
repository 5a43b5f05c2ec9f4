"""Formulas compiled to a tape of instructions, evaluated for all joints at once."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glassgait.models.a1.robot import Array
from glassgait.models.policies.expression import Expression

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


class _Nodes:
    """The distinct sub-formulas of formulas, numbered in the order in which they can be evaluated.

    Attributes:
        keys: Operator of each, and what it is applied to: the numbers of its operands, the value of
            a constant, the index of a variable.
        heights: Operators on the longest way down from each.
    """

    def __init__(self) -> None:
        self.keys: list[tuple[str, Any]] = []
        self.heights: list[int] = []
        self._number_of_key: dict[tuple[str, Any], int] = {}
        self._number_of_object: dict[int, int] = {}

    def add(self, formula: Expression) -> int:
        """Adds a formula, which must outlive this object, and returns its number."""
        # A list of what is still to visit: derivatives may be deeper than Python's stack. Their
        # parts are shared, so that a part that was met before is not walked through again.
        numbers, pending = self._number_of_object, [formula]
        while pending:
            node = pending[-1]
            missing = [operand for operand in node.operands if id(operand) not in numbers]
            if missing:
                pending += reversed(missing)
                continue
            pending.pop()
            numbers[id(node)] = self._number(node)
        return numbers[id(formula)]

    def _number(self, node: Expression) -> int:
        operands = tuple(self._number_of_object[id(operand)] for operand in node.operands)
        leaf = {"variable": node.variable, "constant": node.value}
        key = (node.operator, leaf.get(node.operator, operands))
        if key not in self._number_of_key:
            self._number_of_key[key] = len(self.keys)
            self.keys.append(key)
            self.heights.append(max((1 + self.heights[operand] for operand in operands), default=0))
        return self._number_of_key[key]


class Tape:
    """Formulas compiled to a short list of vectorised instructions.

    Nodes of all formulas that have the same operator and the same height are evaluated together,
    and a sub-formula that occurs twice is evaluated once.
    """

    def __init__(self, expressions: Sequence[Expression], n_variables: int) -> None:
        self._n_variables = n_variables
        nodes = _Nodes()
        roots = [nodes.add(expression) for expression in expressions]
        # The slot of each node among the values: variables first, then constants, then the rest.
        slots = np.zeros(len(nodes.keys), dtype=np.int64)
        constants: list[float] = []
        by_height: dict[tuple[int, str], list[int]] = defaultdict(list)
        for number, (operator, operands) in enumerate(nodes.keys):
            if operator == "variable":
                slots[number] = operands
            elif operator == "constant":
                slots[number] = n_variables + len(constants)
                constants.append(operands)
            else:
                by_height[nodes.heights[number], operator].append(number)
        self._constants = np.array(constants)
        self._instructions: list[_Instruction] = []
        size = n_variables + len(constants)
        for (_, operator), numbers in sorted(by_height.items(), key=lambda item: item[0]):
            sides = np.array([nodes.keys[number][1] for number in numbers]).T
            slots[numbers] = np.arange(size, size + len(numbers))
            self._instructions.append(
                _Instruction(_FUNCTIONS[operator], tuple(slots[sides]), size, size + len(numbers))
            )
            size += len(numbers)
        self._size = size
        self._outputs = slots[roots]

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
