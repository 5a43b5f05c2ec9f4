"""Formulas as a network: PPO changes their numbers, and nothing else."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import torch
from torch import nn

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.numbers import numbers_of, with_numbers, without_zeros
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.readings import Readings
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

UNIT_EFFECT = 0.1
"""What a unit of change does to a target on average (rad): PPO's usual rates suit it."""

LEAST_EFFECT = 1e-3
"""Least effect of a number of 1 on a target (rad) that its unit is reckoned from."""

RIDGE = 1e-2
"""What is added to how little nearly equal terms differ, lest they part too fast."""

_TORCH: dict[str, Callable[..., torch.Tensor]] = {
    "add": torch.add,
    "sub": torch.sub,
    "mul": torch.mul,
    "div": torch.div,
    "neg": torch.neg,
    "sin": torch.sin,
    "cos": torch.cos,
    "tanh": torch.tanh,
    "exp": torch.exp,
    "log": torch.log,
    "sqrt": torch.sqrt,
    "abs": torch.abs,
    "square": torch.square,
    "cube": lambda x: x * x * x,
}


class FormulaNetwork(nn.Module):
    """A policy of formulas in torch; what it learns are the numbers of the formulas it writes.

    Formulas that are mirror images stay so: they share their numbers. Definitions stay as they are.

    The numbers are `start + unit @ changes`, or 0 where they were dropped, and the changes are what
    an optimizer sees. A step of any direction among them does as much to the targets, whether it
    counts metres or rad/s, and whether or not two terms are nearly the same: with actions of
    Gaussian spread a gradient step then is one of the natural gradient.

    Attributes:
        changes: Changes of the numbers (p), in units.
    """

    start: torch.Tensor
    unit: torch.Tensor
    kept: torch.Tensor
    _scale: torch.Tensor
    _offset: torch.Tensor
    _stance: torch.Tensor
    _least: torch.Tensor
    _greatest: torch.Tensor

    def __init__(self, policy: FormulaPolicy) -> None:
        """
        Args:
            policy: The policy to begin with.
        """
        super().__init__()
        self._file, self._robot = policy.to_file(), policy.robot
        self._written = self._file.written()
        numbers = [value for formula in self._written.values() for value in numbers_of(formula)]
        self.register_buffer("start", torch.tensor(numbers))
        self.register_buffer("unit", torch.eye(len(numbers)))
        self.register_buffer("kept", torch.ones(len(numbers)))
        self.changes = nn.Parameter(torch.zeros(len(numbers)))
        counts = [len([*numbers_of(own)]) for own in self._written.values()]
        ends = np.cumsum(counts).tolist()
        # Where each formula's numbers stand among all.
        self._spans = dict(zip(self._written, map(slice, [0, *ends], ends), strict=True))
        names = self._file.vocabulary.names
        units = RobotUnits.of(policy.robot, names)
        self.register_buffer("_scale", _tensor(units.scale), persistent=False)
        self.register_buffer("_offset", _tensor(units.offset), persistent=False)
        self.register_buffer("_stance", _tensor(policy.robot.default_stance), persistent=False)
        ends = policy.readings or Readings(())
        for name, values in zip(("_least", "_greatest"), ends.ends(names), strict=True):
            self.register_buffer(name, _tensor(values), persistent=False)
        self._states = indices_of("machine state", names)
        self._mirror: FormulaMirror | None = None
        if self._file.mirror is not None:
            self._mirror = FormulaMirror.of(self._file.vocabulary, self._file.mirror)
            reflection = reflect_observation(names, self._file.mirror)
            self._reflect_index = torch.from_numpy(reflection.index)
            self._reflect_sign = _tensor(reflection.sign)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Maps observations (n, n_observations) to actions (n, 12)."""
        return self._actions(observation, self._numbers())

    @property
    def n_numbers(self) -> int:
        """Number of the numbers that were not dropped."""
        return int(self.kept.sum())

    def balance(self, observations: torch.Tensor) -> None:
        """Sets the units by what the numbers do where a robot goes.

        Args:
            observations: Samples (m, n_observations).
        """
        slopes = self._slopes(observations)
        blocks = []
        for span in self._spans.values():
            own = slopes[:, :, span].flatten(0, 1).double()
            # Of all numbers those of one formula alone work together.
            alone = own.square().sum(dim=0).div(len(observations)).sqrt().clamp(min=LEAST_EFFECT)
            likeness = (own / alone).T @ (own / alone) / len(observations)
            squares, directions = torch.linalg.eigh(likeness)
            apart = directions @ torch.diag((squares.clamp(min=0.0) + RIDGE).rsqrt())
            blocks.append(UNIT_EFFECT * (apart @ directions.T) / alone[:, None])
        self.unit.copy_(torch.block_diag(*blocks))

    def prune(self, count: int, observations: torch.Tensor) -> None:
        """Drops the numbers that move their targets least, until so many are left.

        What a dropped term adds on average goes to the constant that its formula begins with, and
        such a constant is never dropped.

        Args:
            count: Number of the numbers that are left.
            observations: Samples of where robots go (m, n_observations).
        """
        numbers, slopes = self._numbers().detach(), self._slopes(observations)
        moved = torch.full_like(numbers, torch.inf)
        mean = torch.zeros_like(numbers)
        for place, formula in self._written.items():
            span = self._spans[place]
            own = slice(span.start + _begins_with_number(formula), span.stop)
            part = slopes[self._rows(place, observations), place[-1], own] * numbers[own]
            moved[own], mean[own] = part.std(dim=0, correction=0), part.mean(dim=0)
        moved[self.kept == 0.0] = -1.0
        dropped = torch.argsort(moved)[: len(numbers) - count]
        for place, formula in self._written.items():
            span = self._spans[place]
            own = dropped[(dropped >= span.start) & (dropped < span.stop)]
            if _begins_with_number(formula):
                self.start[span.start] += mean[own][self.kept[own] == 1.0].sum()
        self.kept[dropped] = 0.0

    def to_policy(self) -> FormulaPolicy:
        """Returns the policy with the numbers as they are now."""
        remaining = iter(self._numbers().detach().double().tolist())
        written = {
            place: without_zeros(with_numbers(formula, remaining))
            for place, formula in self._written.items()
        }
        every = written if self._mirror is None else self._mirror.complete(written)
        return FormulaPolicy.from_file(self._file.with_formulas(every), self._robot)

    def _numbers(self) -> torch.Tensor:
        return self.kept * (self.start + self.unit @ self.changes)

    def _slopes(self, observations: torch.Tensor) -> torch.Tensor:
        """Differentiates targets by numbers (m, 12, p; rad), each by those of its own formula."""
        numbers = self._numbers().detach()
        slopes = torch.zeros((len(observations), quadruped.N_JOINTS, len(numbers)))
        n_states = self._file.n_states
        for state in [()] if n_states is None else [(index,) for index in range(n_states)]:
            rows = self._rows((*state, 0), observations)
            for joint, (own, formula) in enumerate(self._formulas(state, observations[rows])):
                slopes[rows, joint, own] = torch.func.jacfwd(formula)(numbers[own])
        return slopes

    def _rows(self, place: Place, observations: torch.Tensor) -> torch.Tensor:
        """Finds which samples (m) are in the state that a formula is of."""
        if len(place) == 1:
            return torch.ones(len(observations), dtype=torch.bool)
        return observations[:, self._states].argmax(dim=1) == place[0]

    def _actions(self, observation: torch.Tensor, numbers: torch.Tensor) -> torch.Tensor:
        if self._file.n_states is None:
            targets = self._targets((), observation, numbers)
        else:
            state = observation[:, self._states].argmax(dim=1)
            rows = [torch.nonzero(state == index).flatten() for index in range(len(self._states))]
            parts = [
                self._targets((index,), observation[own], numbers) for index, own in enumerate(rows)
            ]
            # Each row has a state, so that the parts are all rows in another order.
            targets = torch.cat(parts)[torch.argsort(torch.cat(rows))]
        return (targets - self._stance) / self._robot.action_scale

    def _targets(
        self, state: tuple[int, ...], observation: torch.Tensor, numbers: torch.Tensor
    ) -> torch.Tensor:
        """Evaluates the formulas of a state, or of every state: targets (n, 12; rad)."""
        formulas = self._formulas(state, observation)
        return torch.stack([formula(numbers[own]) for own, formula in formulas], dim=1)

    def _formulas(
        self, state: tuple[int, ...], observation: torch.Tensor
    ) -> Iterator[tuple[slice, Callable[[torch.Tensor], torch.Tensor]]]:
        """Yields each joint's formula: where its numbers stand, and what maps them to targets."""
        own = self._variables(observation)
        image = own
        if self._mirror is not None:
            image = self._variables(observation[:, self._reflect_index] * self._reflect_sign)
        for joint in range(quadruped.N_JOINTS):
            place: Place = (*state, joint)
            if place in self._written:
                yield self._spans[place], partial(self._evaluate, place, own)
            else:
                assert self._mirror is not None
                there, sign = self._mirror.place(place), float(REFLECT_JOINTS.sign[joint])
                yield (
                    self._spans[there],
                    lambda numbers, there=there, sign=sign: (
                        sign * self._evaluate(there, image, numbers)
                    ),
                )

    def _variables(self, observation: torch.Tensor) -> list[torch.Tensor]:
        read = (observation / self._scale + self._offset).clamp(self._least, self._greatest)
        quantities = list(read.unbind(dim=1))
        definitions = (definition.formula for definition in self._file.vocabulary.definitions)
        return quantities + [
            _value(formula, quantities, map(torch.tensor, numbers_of(formula)))
            for formula in definitions
        ]

    def _evaluate(
        self, place: Place, variables: list[torch.Tensor], numbers: torch.Tensor
    ) -> torch.Tensor:
        """Evaluates a formula with numbers of its own (n; rad)."""
        # A formula that is a number is one for every robot.
        value = _value(self._written[place], variables, iter(numbers.unbind()))
        return value.expand_as(variables[0])


def _value(
    formula: Expression, variables: list[torch.Tensor], numbers: Iterator[torch.Tensor]
) -> torch.Tensor:
    """Evaluates a formula whose constants are the next of `numbers`."""
    match formula.operator:
        case "constant":
            return next(numbers)
        case "variable":
            return variables[formula.variable]
        case operator:
            operands = [_value(operand, variables, numbers) for operand in formula.operands]
            return _TORCH[operator](*operands)


def _begins_with_number(formula: Expression) -> bool:
    """Returns whether the first summand of a formula is a number."""
    while formula.operator in ("add", "sub"):
        formula = formula.operands[0]
    return formula.operator == "constant"


def _tensor(values: Array) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
