"""Formulas compiled to a tape of instructions, evaluated for all joints at once."""

import math
from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import Expression

_FUNCTIONS: dict[str, Callable[..., Array]] = {
    "div": np.divide,
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

BLOCK = 2_048
"""Observations evaluated at once, to limit memory: long formulas need 10,000 numbers for each."""


class _Function:
    """Evaluates a function of one or two operands: nodes (k, ...) from all values (size, ...)."""

    def __init__(self, operator: str, operands: Sequence[Any]) -> None:
        self._function = _FUNCTIONS[operator]
        self._operands = np.array(operands, dtype=np.intp).T

    def __call__(self, values: Array) -> Array:
        return self._function(*values[self._operands])


def _transposed(chains: Sequence[Sequence[Any]]) -> list[list[Any]]:
    """Transposes chains of unequal length, sorted from longest to shortest."""
    places = range(len(chains[0]))
    return [[chain[place] for chain in chains if len(chain) > place] for place in places]


class _Products:
    """Products of any number of operands, taken from left to right.

    The fixed order makes results equal to the last digit for one robot, for many, and in C.
    """

    def __init__(self, operands: Sequence[Sequence[int]]) -> None:
        # Slots of each node's operands, the longest chain first.
        lengths = [len(chain) for chain in operands]
        self._flat = np.concatenate(operands).astype(np.intp)
        self._starts = np.cumsum([0, *lengths[:-1]])
        self._nodes = np.repeat(np.arange(len(operands)), lengths)
        self._places = [np.array(slots, dtype=np.intp) for slots in _transposed(operands)]

    def __call__(self, values: Array) -> Array:
        return self._of_row(values) if values.ndim == 1 else self._of_rows(values)

    def _of_row(self, values: Array) -> Array:
        return np.multiply.reduceat(values[self._flat], self._starts)

    def _of_rows(self, values: Array) -> Array:
        first, *others = self._places
        product = values[first]
        for operands in others:
            product[: len(operands)] *= values[operands]
        return product


class _Sums(_Products):
    """Sums of any number of operands with signs 1 or -1, taken from left to right."""

    def __init__(self, operands: Sequence[Sequence[int]], signs: Sequence[Sequence[float]]) -> None:
        super().__init__(operands)
        self._signs = np.concatenate(signs)
        self._signs_of_places = [np.array(column)[:, None] for column in _transposed(signs)]

    def _of_row(self, values: Array) -> Array:
        # `np.add.reduceat` would add in pairs, in another order. Sums start from -0, since adding
        # it changes no number, not even the sign of a zero.
        total = np.full(len(self._starts), -0.0)
        np.add.at(total, self._nodes, self._signs * values[self._flat])
        return total

    def _of_rows(self, values: Array) -> Array:
        places = zip(self._places, self._signs_of_places, strict=True)
        first, sign = next(places)
        total = sign * values[first]
        for operands, sign in places:
            total[: len(operands)] += sign * values[operands]
        return total


class _Nodes:
    """The distinct sub-formulas of formulas, numbered in an order in which they can be evaluated.

    Nested sums are one node, and so are nested products, if the order of evaluation stays the same.
    """

    def __init__(self) -> None:
        # A key is an operator with the numbers and signs of its operands, the value of a constant,
        # or the index of a variable. A height counts the operators on the longest path to a leaf.
        self.keys: list[tuple[str, Any]] = []
        self.heights: list[int] = []
        self._number_of_key: dict[tuple[str, Any], int] = {}
        self._number_of_object: dict[int, int] = {}
        self._chains: dict[int, tuple[str, list[Expression], list[float]]] = {}

    def add(self, formula: Expression) -> int:
        """Adds a formula, which must outlive this object, and returns its number."""
        # List the nodes to visit, since derivatives may be deeper than Python's stack. Shared
        # sub-formulas are visited once.
        numbers, pending = self._number_of_object, [formula]
        while pending:
            node = pending[-1]
            if id(node) not in self._chains:
                self._chains[id(node)] = _chain(node)
            _, operands, _ = self._chains[id(node)]
            missing = [operand for operand in operands if id(operand) not in numbers]
            # Visit the operands first, from left to right.
            if missing:
                pending += reversed(missing)
                continue
            pending.pop()
            numbers[id(node)] = self._number(node)
        return numbers[id(formula)]

    def _number(self, node: Expression) -> int:
        # Equal sub-formulas have equal keys, and one number.
        operator, operands, signs = self._chains[id(node)]
        numbers = tuple(self._number_of_object[id(operand)] for operand in operands)
        leaf = {"variable": node.variable, "constant": node.value}
        key = (operator, leaf.get(operator, (numbers, tuple(signs))))
        if key not in self._number_of_key:
            self._number_of_key[key] = len(self.keys)
            self.keys.append(key)
            self.heights.append(max((1 + self.heights[number] for number in numbers), default=0))
        return self._number_of_key[key]


def _chain(formula: Expression) -> tuple[str, list[Expression], list[float]]:
    """Returns the operator of a node, its operands from left to right, and their signs in a sum."""
    operands: list[Expression] = []
    match formula.operator:
        # Walk down the left side, which is evaluated first, and reverse the order at the end.
        case "add" | "sub" | "neg":
            signs: list[float] = []
            while formula.operator in ("add", "sub"):
                left, right = formula.operands
                operands.append(right)
                signs.append(1.0 if formula.operator == "add" else -1.0)
                formula = left
            negative = formula.operator == "neg"
            operands.append(formula.operands[0] if negative else formula)
            signs.append(-1.0 if negative else 1.0)
            return "sum", operands[::-1], signs[::-1]
        case "mul":
            while formula.operator == "mul":
                formula, right = formula.operands
                operands.append(right)
            return "product", [*operands, formula][::-1], []
        case operator:
            return operator, list(formula.operands), []


class Tape:
    """Formulas compiled to a short list of vectorised instructions.

    Nodes of the same operator and height are evaluated together, and repeated sub-formulas once.
    Every value has a slot: variables come first, then constants, then each instruction's nodes.
    """

    def __init__(self, expressions: Sequence[Expression], n_variables: int) -> None:
        self.n_variables = n_variables
        nodes = _Nodes()
        roots = [nodes.add(expression) for expression in expressions]

        # Give variables and constants their slots, and collect the other nodes by height.
        slots = np.zeros(len(nodes.keys), dtype=np.intp)
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

        # One instruction evaluates all nodes of a height and operator.
        self._instructions: list[tuple[slice, _Function | _Products]] = []
        size = n_variables + len(constants)
        for (_, operator), numbers in sorted(by_height.items(), key=lambda item: item[0]):
            # Put the longest chain first.
            numbers.sort(key=lambda number: -len(nodes.keys[number][1][0]))
            places = slice(size, size + len(numbers))
            slots[numbers] = np.arange(places.start, places.stop)
            keys = [nodes.keys[number][1] for number in numbers]
            chains: list[Any] = [slots[list(chain)] for chain, _ in keys]
            if operator == "sum":
                instruction = _Sums(chains, [signs for _, signs in keys])
            elif operator == "product":
                instruction = _Products(chains)
            else:
                instruction = _Function(operator, chains)
            self._instructions.append((places, instruction))
            size = places.stop
        self._size = size
        self._outputs = slots[roots]

    def __call__(self, observation: Array) -> Array:
        """Evaluates all formulas (..., k) on observations (..., n)."""
        if observation.ndim == 1:
            return self._evaluate(observation)
        rows = observation.reshape(math.prod(observation.shape[:-1]), self.n_variables)
        results = np.empty((len(rows), len(self._outputs)))
        for start in range(0, len(rows), BLOCK):
            results[start : start + BLOCK] = self._evaluate(rows[start : start + BLOCK].T).T
        return results.reshape(*observation.shape[:-1], len(self._outputs))

    def _evaluate(self, variables: Array) -> Array:
        """Evaluates all formulas (k, ...) from the variables (n, ...)."""
        # Nodes lie along the first axis, so that an instruction writes one block of memory.
        values = np.empty((self._size, *variables.shape[1:]))
        values[: self.n_variables] = variables
        constants = slice(self.n_variables, self.n_variables + len(self._constants))
        values[constants].T[...] = self._constants
        with np.errstate(all="ignore"):
            for places, instruction in self._instructions:
                values[places] = instruction(values)
        return values[self._outputs]
