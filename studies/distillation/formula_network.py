"""Formulas as a network, whose only parameters are the numbers in the formulas."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import (
    Expression,
    WeightedSum,
    numbers_of,
    with_numbers,
    without_zeros,
)
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.quantities import Readings, RobotUnits
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import REFLECT_JOINTS, indices_of, reflect_observation

UNIT_EFFECT = 0.3
"""Mean effect of a unit change on a target (rad), chosen for PPO's usual learning rates."""

LEAST_EFFECT = 1e-3
"""Lower limit of a number's effect on a target (rad), to compute its unit."""

RIDGE = 1e-2
"""Added to the eigenvalues, which limits steps along differences of nearly equal terms."""


@dataclass(frozen=True)
class _Weights:
    """The numbers that multiply terms in an RM state, in formulas of the robot or its mirror image.

    `rest` (m, 12) is 1 or -1 where a joint has a term without a number. In the other tensors, an
    entry is a number's index, the term and joint that it multiplies, and its sign.
    """

    rest: torch.Tensor
    numbers: torch.Tensor
    terms: torch.Tensor
    joints: torch.Tensor
    signs: torch.Tensor

    def matrix(self, numbers: torch.Tensor) -> torch.Tensor:
        """Returns the factor of each term of each joint (m, 12)."""
        weights = self.signs * numbers[self.numbers]
        return self.rest.index_put((self.terms, self.joints), weights, accumulate=True)


class FormulaNetwork(nn.Module):
    """A policy of formulas in torch, whose parameters are the numbers of its file's formulas.

    Each number must be the weight of a term. Terms are evaluated once, and targets are a product of
    matrices. Mirror images share their numbers. Definitions do not change.

    The numbers are `start + unit @ changes`, where `changes` is the parameter. Steps of equal size
    in it change the targets equally, as steps of the natural gradient do.
    """

    start: torch.Tensor
    unit: torch.Tensor

    def __init__(self, policy: FormulaPolicy, name: str = "formulas") -> None:
        """Begins with the numbers of a policy; error messages use the name."""
        super().__init__()
        self._name, self._robot = name, policy.robot
        self._file = file = policy.to_file()
        self._written, names = file.written(), file.vocabulary.names
        sums: dict[Place, WeightedSum] = {}
        for place, formula in self._written.items():
            if (weighted := WeightedSum.of(formula)) is None:
                raise InputError(
                    f"{name}: has numbers that are not weights of terms, and cannot be refined; "
                    "name another policy with --policy"
                )
            sums[place] = weighted

        # The numbers, and each formula's slice of them.
        numbers = [value for formula in self._written.values() for value in numbers_of(formula)]
        ends = np.cumsum([len(weighted.terms) for weighted in sums.values()]).tolist()
        self._spans = dict(zip(sums, map(slice, [0, *ends], ends), strict=False))
        self.register_buffer("start", torch.tensor(numbers))
        self.register_buffer("unit", torch.eye(len(numbers)))
        self.changes = nn.Parameter(torch.zeros(len(numbers)))

        # Units and limits of the formulas' inputs.
        units, readings = RobotUnits.of(policy.robot, names), policy.readings or Readings(())
        self._scale, self._offset = _tensor(units.scale), _tensor(units.offset)
        self._least, self._greatest = map(_tensor, readings.ends(names))
        self._stance = _tensor(policy.robot.default_stance)
        self._states = indices_of("machine state", names)
        self._mirror: FormulaMirror | None = None
        if file.mirror is not None:
            self._mirror = FormulaMirror.of(file.vocabulary, file.mirror)
            self._reflect = reflect_observation(names, file.mirror)

        # The terms; a term in several formulas is evaluated once.
        terms = [term for each in sums.values() for term in (*each.terms, each.rest)]
        columns = {term: column for column, term in enumerate(dict.fromkeys(terms))}
        self._tape = Tape([file.vocabulary.expanded(term) for term in columns], len(names))
        states = [()] if file.n_states is None else [(state,) for state in range(file.n_states)]
        self._weights = [
            [self._weights_of(state, mirrored, sums, columns) for mirrored in (False, True)]
            for state in states
        ]

    def _weights_of(
        self,
        state: tuple[int, ...],
        mirrored: bool,
        sums: Mapping[Place, WeightedSum],
        columns: Mapping[Expression, int],
    ) -> _Weights:
        """Returns the weights of joints whose formulas are mirror images, or of the others."""
        # Numbers with their terms, joints and signs, a joint at a time.
        rest = torch.zeros((len(columns), quadruped.N_JOINTS))
        entries: list[tuple[int, int, int, float]] = []
        for joint in range(quadruped.N_JOINTS):
            place, sign = (*state, joint), 1.0
            if mirrored == (place in sums):
                continue
            if mirrored:
                assert self._mirror is not None
                place, sign = self._mirror.place(place), float(REFLECT_JOINTS.sign[joint])
            rest[columns[sums[place].rest], joint] = sign
            for number, term in enumerate(sums[place].terms, self._spans[place].start):
                entries.append((number, columns[term], joint, sign))

        index = torch.tensor([entry[:3] for entry in entries], dtype=torch.long).reshape(-1, 3)
        numbers, terms, joints = index.unbind(dim=1)
        return _Weights(rest, numbers, terms, joints, torch.tensor([entry[3] for entry in entries]))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Maps observations (n, n_observations) to actions (n, 12)."""
        read, rows, numbers = self._terms(observation), self._rows(observation), self._numbers()
        by_state = []
        for robots, sides in zip(rows, self._weights, strict=True):
            matrices = [side.matrix(numbers) for side in sides]
            # Without a mirror, there are no terms for the second side.
            products = [terms[robots] @ each for terms, each in zip(read, matrices, strict=False)]
            by_state.append(torch.stack(products).sum(dim=0))
        # Each robot is in one state; restore their order.
        targets = torch.cat(by_state)[torch.argsort(torch.cat(rows))]
        # Otherwise PPO would continue without any message.
        self._refuse_not_finite("the formula", targets, observation)
        return (targets - self._stance) / self._robot.action_scale

    def balance(self, observations: torch.Tensor) -> None:
        """Sets the units from the numbers' effects at observations (m, n_observations)."""
        slopes = self._slopes(observations)
        self._refuse_not_finite("a slope of the formula", slopes, observations)
        blocks = []
        for span in self._spans.values():
            effects = slopes[:, :, span].flatten(0, 1).double()
            # Numbers of different formulas have independent effects.
            sizes = effects.square().sum(dim=0).div(len(observations)).sqrt()
            sizes = sizes.clamp(min=LEAST_EFFECT)
            correlation = (effects / sizes).T @ (effects / sizes) / len(observations)
            # The inverse square root of the correlation makes all directions equally effective.
            squares, directions = torch.linalg.eigh(correlation)
            whitened = directions @ torch.diag((squares.clamp(min=0.0) + RIDGE).rsqrt())
            blocks.append(UNIT_EFFECT * (whitened @ directions.T) / sizes[:, None])
        self.unit.copy_(torch.block_diag(*blocks))

    def to_policy(self) -> FormulaPolicy:
        remaining = iter(self._numbers().detach().double().tolist())
        written = {
            place: without_zeros(with_numbers(formula, remaining))
            for place, formula in self._written.items()
        }
        every = written if self._mirror is None else self._mirror.complete(written)
        return FormulaPolicy.from_file(self._file.with_formulas(every), self._robot)

    def _numbers(self) -> torch.Tensor:
        return self.start + self.unit @ self.changes

    def _slopes(self, observations: torch.Tensor) -> torch.Tensor:
        """Returns the derivatives of targets by numbers (n, 12, p; rad)."""
        slopes = torch.zeros((len(observations), quadruped.N_JOINTS, len(self.start)))
        read = self._terms(observations)
        for robots, sides in zip(self._rows(observations), self._weights, strict=True):
            for terms, side in zip(read, sides, strict=False):
                effects = side.signs * terms[robots][:, side.terms]
                slopes[robots[:, None], side.joints, side.numbers] = effects
        return slopes

    def _rows(self, observation: torch.Tensor) -> list[torch.Tensor]:
        """Returns the indices of the robots in each state."""
        if self._file.n_states is None:
            return [torch.arange(len(observation))]
        state = observation[:, self._states].argmax(dim=1)
        return [torch.nonzero(state == index).flatten() for index in range(self._file.n_states)]

    def _terms(self, observation: torch.Tensor) -> list[torch.Tensor]:
        """Evaluates all terms (n, m) for observations and, with a mirror, for their images."""
        sides = [observation]
        if self._mirror is not None:
            sign = _tensor(self._reflect.sign)
            sides.append(observation[:, torch.from_numpy(self._reflect.index)] * sign)
        read = [
            (side / self._scale + self._offset).clamp(self._least, self._greatest) for side in sides
        ]
        return [torch.from_numpy(self._tape(each.double().numpy())).float() for each in read]

    def _refuse_not_finite(
        self, name: str, values: torch.Tensor, observations: torch.Tensor
    ) -> None:
        """Raises an InputError if values of joints' formulas (n, 12, ...) are not finite."""
        invalid = torch.nonzero(~values.isfinite()).tolist()
        if not invalid:
            return
        (row, joint, *_), state = invalid[0], ""
        if self._file.n_states is not None:
            state = f" in state {int(observations[row, self._states].argmax())}"
        raise InputError(
            f"{self._name}: {name} of {quadruped.JOINTS[joint]}{state} is not finite for a "
            "walking robot; change it if it divides by a quantity that may be 0, or name another "
            "policy with --policy"
        )


def _tensor(values: Array) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
