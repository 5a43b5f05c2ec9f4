"""Several environments that one policy learns in at once."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from glassgait.diagrams.batch import BatchStep
from glassgait.studies.training.environment import (
    Environment,
    TrainingEnvironment,
    TrainingStep,
)


class JointEnvironment(Environment):
    """Environments side by side, whose robots are those of the first, then those of the next.

    Attributes:
        parts: The environments.
    """

    def __init__(self, parts: Sequence[TrainingEnvironment]) -> None:
        """
        Args:
            parts: Environments whose robots observe alike, of one source of randomness.
        """
        self.parts = parts
        self._n_robots = [part.simulator.n_robots for part in parts]

    @property
    def difficulty(self) -> float:
        return self.parts[0].difficulty

    @difficulty.setter
    def difficulty(self, factor: float) -> None:
        for part in self.parts:
            part.difficulty = factor

    @property
    def hardship(self) -> float:
        return self.parts[0].hardship

    @hardship.setter
    def hardship(self, share: float) -> None:
        for part in self.parts:
            part.hardship = share

    def draw_worlds(self) -> None:
        """Draws the frictions of all groups anew, and lays ground of today's hardship."""
        for part in self.parts:
            part.draw_worlds()

    def observe(self) -> TensorDict:
        """Returns the observation groups of all robots."""
        return _joined([part.observe() for part in self.parts])

    def step(self, actions: torch.Tensor) -> TrainingStep:
        """Holds actions (n, 12) for one control step and resets the robots that ended."""
        own = torch.split(actions, self._n_robots)
        steps = [part.step(each) for part, each in zip(self.parts, own, strict=True)]
        costs = [step.settling_cost for step in steps if step.settling_cost is not None]
        tasks = {
            name: np.concatenate([getattr(step.task, name) for step in steps])
            for name in BatchStep._fields
        }
        return TrainingStep(
            observations=_joined([step.observations for step in steps]),
            rewards=torch.cat([step.rewards for step in steps]),
            dones=torch.cat([step.dones for step in steps]),
            time_outs=torch.cat([step.time_outs for step in steps]),
            task=BatchStep(**tasks),
            settling_cost=np.concatenate(costs) if costs else None,
        )

    def to_arrays(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Returns all that a checkpoint needs: named arrays, and values that JSON can hold."""
        arrays, values = {}, {}
        for i, part in enumerate(self.parts):
            own, values[str(i)] = part.to_arrays()
            arrays |= {f"{i}:{name}": array for name, array in own.items()}
        return arrays, values

    def restore(self, arrays: dict[str, np.ndarray], values: dict[str, Any]) -> None:
        """Continues from what `to_arrays` returned."""
        for i, part in enumerate(self.parts):
            start = f"{i}:"
            own = {k.removeprefix(start): v for k, v in arrays.items() if k.startswith(start)}
            part.restore(own, values[str(i)])


def _joined(observations: Sequence[TensorDict]) -> TensorDict:
    joined = torch.cat(list(observations))
    assert isinstance(joined, TensorDict)
    return joined
