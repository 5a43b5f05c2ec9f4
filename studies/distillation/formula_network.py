"""Formulas as a network: PPO changes their numbers, and nothing else."""

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
from glassgait.models.policies.policy import first_not_finite
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import REFLECT_JOINTS, indices_of, reflect_observation

UNIT_EFFECT = 0.1
"""Average effect of a unit of change on a target (rad): PPO's usual rates suit it."""

LEAST_EFFECT = 1e-3
"""Least effect of a number of 1 on a target (rad) that its unit is computed from."""

RIDGE = 1e-2
"""Added to the small differences of nearly equal terms, so that they do not part too fast."""


@dataclass(frozen=True)
class _Weights:
    """The numbers that multiply terms in one state, in formulas of the robot or of its image.

    `rest` (m, 12) holds the terms that no number multiplies, 1 or -1 where one belongs to a joint.
    Number, times its sign, multiplies the term of the joint.
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
    """A policy of formulas in torch; it learns the numbers of the formulas that its file holds.

    Each number must be the weight of a term. Terms are evaluated once, and targets are a product of
    matrices. Formulas that are mirror images stay so: they share their numbers. Definitions stay as
    they are.

    The numbers are `start + unit @ changes`, and an optimizer sees the changes. A step of any
    direction among them does as much to the targets: a step of the natural gradient.
    """

    start: torch.Tensor
    unit: torch.Tensor

    def __init__(self, policy: FormulaPolicy, name: str = "formulas") -> None:
        """Begins with a policy, which errors call by the name."""
        super().__init__()
        self._name, self._robot = name, policy.robot
        self._file = file = policy.to_file()
        self._written, names = file.written(), file.vocabulary.names
        sums: dict[Place, WeightedSum] = {}
        for place, formula in self._written.items():
            if (weighted := WeightedSum.of(formula)) is None:
                raise InputError(
                    f"{name}: has numbers that are not weights of terms, and cannot learn; name "
                    "another policy with --policy"
                )
            sums[place] = weighted

        # The numbers, and where each formula's stand among all.
        numbers = [value for formula in self._written.values() for value in numbers_of(formula)]
        ends = np.cumsum([len(weighted.terms) for weighted in sums.values()]).tolist()
        self._spans = dict(zip(sums, map(slice, [0, *ends], ends), strict=False))
        self.register_buffer("start", torch.tensor(numbers))
        self.register_buffer("unit", torch.eye(len(numbers)))
        self.changes = nn.Parameter(torch.zeros(len(numbers)))

        # The observations as formulas read them.
        units, readings = RobotUnits.of(policy.robot, names), policy.readings or Readings(())
        self._scale, self._offset = _tensor(units.scale), _tensor(units.offset)
        self._least, self._greatest = map(_tensor, readings.ends(names))
        self._stance = _tensor(policy.robot.default_stance)
        self._states = indices_of("machine state", names)
        self._mirror: FormulaMirror | None = None
        if file.mirror is not None:
            self._mirror = FormulaMirror.of(file.vocabulary, file.mirror)
            self._reflect = reflect_observation(names, file.mirror)

        # The terms; one that stands in several formulas is evaluated once.
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
        """Finds the weights of joints whose formulas read the mirror image, or of the others."""
        # Numbers with their terms, joints and signs, a joint at a time.
        rest = torch.zeros((len(columns), quadruped.N_JOINTS))
        found: list[tuple[int, int, int, float]] = []
        for joint in range(quadruped.N_JOINTS):
            place, sign = (*state, joint), 1.0
            if mirrored == (place in sums):
                continue
            if mirrored:
                assert self._mirror is not None
                place, sign = self._mirror.place(place), float(REFLECT_JOINTS.sign[joint])
            rest[columns[sums[place].rest], joint] = sign
            for number, term in enumerate(sums[place].terms, self._spans[place].start):
                found.append((number, columns[term], joint, sign))

        # As tensors.
        index = torch.tensor([entry[:3] for entry in found], dtype=torch.long).reshape(-1, 3)
        numbers, terms, joints = index.unbind(dim=1)
        return _Weights(rest, numbers, terms, joints, torch.tensor([entry[3] for entry in found]))

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Maps observations (n, n_observations) to actions (n, 12)."""
        read, rows, numbers = self._terms(observation), self._rows(observation), self._numbers()
        parts = []
        for here, sides in zip(rows, self._weights, strict=True):
            matrices = [side.matrix(numbers) for side in sides]
            # Without a mirror image there is nothing that the second side reads.
            products = [terms[here] @ each for terms, each in zip(read, matrices, strict=False)]
            parts.append(torch.stack(products).sum(dim=0))
        # Each row has a state, so that the parts are all rows in another order.
        targets = torch.cat(parts)[torch.argsort(torch.cat(rows))]
        # PPO would go on, and learn nothing but that.
        self._refuse_not_finite("the formula", targets, observation)
        return (targets - self._stance) / self._robot.action_scale

    def balance(self, observations: torch.Tensor) -> None:
        """Sets the units by the numbers' effects at observations (m, n_observations)."""
        slopes = self._slopes(observations)
        self._refuse_not_finite("a slope of the formula", slopes, observations)
        blocks = []
        for span in self._spans.values():
            effects = slopes[:, :, span].flatten(0, 1).double()
            # Only the numbers of one formula work together.
            sizes = effects.square().sum(dim=0).div(len(observations)).sqrt()
            sizes = sizes.clamp(min=LEAST_EFFECT)
            likeness = (effects / sizes).T @ (effects / sizes) / len(observations)
            # The inverse square root of the likeness makes all directions equally effective.
            squares, directions = torch.linalg.eigh(likeness)
            apart = directions @ torch.diag((squares.clamp(min=0.0) + RIDGE).rsqrt())
            blocks.append(UNIT_EFFECT * (apart @ directions.T) / sizes[:, None])
        self.unit.copy_(torch.block_diag(*blocks))

    def to_policy(self) -> FormulaPolicy:
        """Returns the policy with the current numbers."""
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
        """Differentiates targets by numbers (n, 12, p; rad)."""
        slopes = torch.zeros((len(observations), quadruped.N_JOINTS, len(self.start)))
        read = self._terms(observations)
        for here, sides in zip(self._rows(observations), self._weights, strict=True):
            for terms, side in zip(read, sides, strict=False):
                effects = side.signs * terms[here][:, side.terms]
                slopes[here[:, None], side.joints, side.numbers] = effects
        return slopes

    def _rows(self, observation: torch.Tensor) -> list[torch.Tensor]:
        """Returns the indices of the robots in each state."""
        if self._file.n_states is None:
            return [torch.arange(len(observation))]
        state = observation[:, self._states].argmax(dim=1)
        return [torch.nonzero(state == index).flatten() for index in range(self._file.n_states)]

    def _terms(self, observation: torch.Tensor) -> list[torch.Tensor]:
        """Evaluates all terms (n, m), of observations and of their mirror images."""
        seen = [observation]
        if self._mirror is not None:
            sign = _tensor(self._reflect.sign)
            seen.append(observation[:, torch.from_numpy(self._reflect.index)] * sign)
        read = [
            (each / self._scale + self._offset).clamp(self._least, self._greatest) for each in seen
        ]
        return [torch.from_numpy(self._tape(each.double().numpy())).float() for each in read]

    def _refuse_not_finite(self, what: str, values: torch.Tensor, seen: torch.Tensor) -> None:
        """Refuses values of joints' formulas (n, 12, ...) that are not finite."""
        found = first_not_finite(values.detach().numpy())
        if found is None:
            return
        where = ""
        if self._file.n_states is not None:
            where = f" in state {int(seen[found[0], self._states].argmax())}"
        raise InputError(
            f"{self._name}: {what} of {quadruped.JOINTS[found[1]]}{where} is not finite where a "
            "robot walks; change it, as where it divides by what may be 0, or name another policy "
            "with --policy"
        )


def _tensor(values: Array) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))
