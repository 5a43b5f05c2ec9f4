"""Observers that record logs for scores, and observations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics
from glassgait.studies.common.episode import ControlStep, Observer


@dataclass(frozen=True)
class RolloutLog:
    """Log of n robots over T control steps.

    Attributes:
        velocity: Forward speed and yaw rate in the trunk's frame (T, n, 2; m/s, rad/s).
        command: Commanded forward speed and yaw rate (T, n, 2; m/s, rad/s).
        reward: Reward with the reward machine's factor (T, n).
        plain_reward: Reward without the factor (T, n).
        served_dwell: Commanded control steps that transitions served (T, n).
        failures: Flags in the order of `FAILURES` (T, n, 7).
    """

    velocity: Array
    command: Array
    reward: Array
    plain_reward: Array
    served_dwell: Array
    failures: NDArray[np.bool_]

    @classmethod
    def stacked(cls, logs: Sequence["RolloutLog"], axis: int) -> "RolloutLog":
        """Stacks logs along a new axis: 0 for logs of steps, 1 for logs of robots."""
        columns = zip(*(vars(log).values() for log in logs), strict=True)
        return cls(*(np.stack(arrays, axis) for arrays in columns))

    def padded(self, n_steps: int) -> "RolloutLog":
        """Repeats the last step up to `n_steps`, which does not change scores of fallen robots."""
        steps = np.minimum(np.arange(n_steps), len(self.reward) - 1)
        return RolloutLog(**{name: values[steps] for name, values in vars(self).items()})


class Log(Observer):
    """Records a rollout log until every robot has fallen."""

    def __init__(self) -> None:
        self._steps: list[RolloutLog] = []

    def observe(self, step: ControlStep) -> None:
        outcome = step.outcome
        linear, angular = kinematics.base_velocity(step.after.plant)
        log = RolloutLog(
            velocity=np.stack([linear[..., 0], angular[..., 2]], axis=-1),
            command=step.before.command.velocity,
            reward=outcome.reward,
            plain_reward=outcome.plain_reward,
            served_dwell=outcome.served_dwell,
            failures=outcome.failures,
        )
        self._steps.append(log)
        self.done = bool(step.fallen.all())

    def rollout(self, n_steps: int) -> RolloutLog:
        """Returns the log of an episode of `n_steps`."""
        return RolloutLog.stacked(self._steps, axis=0).padded(n_steps)


class Observations(Observer):
    """Records the observations before each control step."""

    def __init__(self) -> None:
        self._rows: list[Array] = []

    def observe(self, step: ControlStep) -> None:
        self._rows.append(step.observation)

    @property
    def array(self) -> Array:
        """Observations (T, n, n_obs)."""
        return np.array(self._rows)
