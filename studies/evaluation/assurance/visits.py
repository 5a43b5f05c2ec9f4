"""What robots observe while a policy moves them, and what they were like at every step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_state import TaskState
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.task.gait import Gait
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.roll_out import make_batch


@dataclass(frozen=True)
class Visits:
    """What n robots visited in T control steps.

    Attributes:
        observation: Observations before each step (T, n, N).
        states: All robots' states before each step (T).
        fell: The step that each robot fell in (n); T where it did not.
    """

    observation: Array
    states: list[TaskState]
    fell: NDArray[np.int64]

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether each robot was up before each step (T, n)."""
        return np.arange(len(self.observation))[:, None] <= self.fell

    @property
    def fallen(self) -> NDArray[np.int64]:
        """The robots that fell."""
        return np.flatnonzero(self.fell < len(self.observation))


def joined(parts: Sequence[Visits]) -> Visits:
    """Puts robots of several walks of as many steps side by side, without their states."""
    observation = np.concatenate([own.observation for own in parts], axis=1)
    return Visits(observation, [], np.concatenate([own.fell for own in parts]))


def visit(gait: Gait, policy: Controller, scenario: Scenario, config: RolloutConfig) -> Visits:
    """Lets the robots of the first seed walk, at the speeds of distillation."""
    scenario = config.at_distilled_speeds(gait, scenario).commanding(scenario)
    n = config.n_robots
    simulator = make_batch(gait, policy, scenario, n_robots=n, seed=config.seed)
    memory, fell = policy.begin(n), np.full(n, config.n_steps)
    observations, states = [], []
    for step in range(config.n_steps):
        observations.append(simulator.observe())
        states.append(simulator.state)
        output = policy.advance(step, observations[-1], memory)
        memory = output.memory
        down = fell < step
        shown = simulator.step(np.where(down[:, None], 0.0, output.action)).failures.any(axis=-1)
        fell = np.where(shown & (fell == config.n_steps), step, fell)
    return Visits(np.array(observations), states, fell)
