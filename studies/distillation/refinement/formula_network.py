"""Formulas as a network: PPO changes their numbers, and nothing else."""

import numpy as np
import torch
from torch import nn

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.numbers import numbers_of, with_numbers, without_zeros
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.formulas.readings import Readings
from glassgait.models.policies.policy import first_not_finite
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import reflect_observation
from glassgait.studies.distillation.refinement.formula_values import Sensed, Written, values_of

UNIT_EFFECT = 0.1
"""What a unit of change does to a target on average (rad): PPO's usual rates suit it."""

LEAST_EFFECT = 1e-3
"""Least effect of a number of 1 on a target (rad) that its unit is reckoned from."""

RIDGE = 1e-2
"""What is added to how little nearly equal terms differ, lest they part too fast."""


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

    def __init__(self, policy: FormulaPolicy, name: str = "formulas") -> None:
        """
        Args:
            policy: The policy to begin with.
            name: What a sentence about it calls it, such as its file's name.
        """
        super().__init__()
        self._name = name
        self._file, self._robot = policy.to_file(), policy.robot
        self._written = self._file.written()
        numbers = [value for formula in self._written.values() for value in numbers_of(formula)]
        self.register_buffer("start", torch.tensor(numbers))
        self.register_buffer("unit", torch.eye(len(numbers)))
        self.register_buffer("kept", torch.ones(len(numbers)))
        self.changes = nn.Parameter(torch.zeros(len(numbers)))
        names = self._file.vocabulary.names
        units = RobotUnits.of(policy.robot, names)
        self.register_buffer("_scale", _tensor(units.scale), persistent=False)
        self.register_buffer("_offset", _tensor(units.offset), persistent=False)
        self.register_buffer("_stance", _tensor(policy.robot.default_stance), persistent=False)
        ends = policy.readings or Readings(())
        for end, values in zip(("_least", "_greatest"), ends.ends(names), strict=True):
            self.register_buffer(end, _tensor(values), persistent=False)
        self._states = indices_of("machine state", names)
        self._mirror: FormulaMirror | None = None
        if self._file.mirror is not None:
            self._mirror = FormulaMirror.of(self._file.vocabulary, self._file.mirror)
            reflection = reflect_observation(names, self._file.mirror)
            self._reflect_index = torch.from_numpy(reflection.index)
            self._reflect_sign = _tensor(reflection.sign)
        held = Written(self._written, self._file.vocabulary, self._mirror, self._file.n_states)
        self._spans, self._values = held.spans, values_of(held)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Maps observations (n, n_observations) to actions (n, 12).

        Raises:
            InputError: if one is not finite: PPO would go on, and learn nothing but that.
        """
        sensed = self._sensed(observation)
        targets = self._values.targets(sensed, self._numbers())
        self._refuse_not_finite("the formula", targets, sensed)
        return (targets - self._stance) / self._robot.action_scale

    @property
    def n_numbers(self) -> int:
        """Number of the numbers that were not dropped."""
        return int(self.kept.sum())

    def balance(self, observations: torch.Tensor) -> None:
        """Sets the units by what the numbers do where a robot goes.

        Args:
            observations: Samples (m, n_observations).

        Raises:
            InputError: if what a number does is not finite there.
        """
        sensed = self._sensed(observations)
        slopes = self._values.slopes(sensed, self._numbers().detach())
        self._refuse_not_finite("a slope of the formula", slopes, sensed)
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
        numbers, sensed = self._numbers().detach(), self._sensed(observations)
        slopes = self._values.slopes(sensed, numbers)
        moved = torch.full_like(numbers, torch.inf)
        mean = torch.zeros_like(numbers)
        for place, formula in self._written.items():
            span = self._spans[place]
            own = slice(span.start + _begins_with_number(formula), span.stop)
            here = sensed.state == (0 if self._file.n_states is None else place[0])
            part = slopes[here, place[-1], own] * numbers[own]
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

    def _refuse_not_finite(self, what: str, values: torch.Tensor, sensed: Sensed) -> None:
        """Refuses what joints' formulas come to (n, 12, ...), if it is not finite."""
        found = first_not_finite(values.detach().numpy())
        if found is not None:
            where = ""
            if self._file.n_states is not None:
                where = f" in state {int(sensed.state[found[0]])}"
            raise InputError(
                f"{self._name}: {what} of {quadruped.JOINTS[found[1]]}{where} is not finite where "
                "a robot walks; change it, as where it divides by what may be 0, or name another "
                "policy with --policy"
            )

    def _sensed(self, observation: torch.Tensor) -> Sensed:
        """Returns what formulas read of observations (n, n_observations)."""
        state = torch.zeros(len(observation), dtype=torch.long)
        if self._file.n_states is not None:
            state = observation[:, self._states].argmax(dim=1)
        image = None
        if self._mirror is not None:
            image = self._read(observation[:, self._reflect_index] * self._reflect_sign)
        return Sensed(self._read(observation), image, state)

    def _read(self, observation: torch.Tensor) -> torch.Tensor:
        """Returns quantities (n, k), within the ranges of readings."""
        return (observation / self._scale + self._offset).clamp(self._least, self._greatest)


def _begins_with_number(formula: Expression) -> bool:
    """Returns whether the first summand of a formula is a number."""
    while formula.operator in ("add", "sub"):
        formula = formula.operands[0]
    return formula.operator == "constant"


def _tensor(values: Array) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
