"""Observers of episodes: logs of all that is scored, and observations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.robots import kinematics, quadruped
from glassgait.studies.common.episode import ControlStep, Observer


@dataclass(frozen=True)
class RolloutLog:
    """Log of n robots over T control steps.

    Attributes:
        velocity: Forward speed and yaw rate in the trunk's frame (T, n, 2; m/s, rad/s).
        command: Commanded forward speed and yaw rate (T, n, 2; m/s, rad/s).
        power: Absolute mechanical power of all joints at the control instants (T, n; W).
        action: Actions (T, n, 12); 0 after a failure.
        expert_acts: Whether the expert acted (T, n).
        reward: Reward with the machine's factor (T, n).
        plain_reward: Reward without it (T, n).
        served_dwell: Control steps of rhythm served by transitions (T, n).
        failures: Flags in the order of `FAILURES` (T, n, 7).
    """

    velocity: Array
    command: Array
    power: Array
    action: Array
    expert_acts: NDArray[np.bool_]
    reward: Array
    plain_reward: Array
    served_dwell: Array
    failures: NDArray[np.bool_]

    @classmethod
    def stacked(cls, logs: Sequence["RolloutLog"], axis: int) -> "RolloutLog":
        """Joins logs along a new axis: 0 of single steps, 1 of single robots."""
        parts = zip(*(vars(log).values() for log in logs), strict=True)
        return cls(*(np.stack(part, axis) for part in parts))

    def padded(self, n_steps: int) -> "RolloutLog":
        """Returns the log with its last step repeated, which changes no score of fallen robots."""
        kept = np.minimum(np.arange(n_steps), len(self.reward) - 1)
        return RolloutLog(**{name: values[kept] for name, values in vars(self).items()})


class Log(Observer):
    """Records everything that is scored, until every robot has fallen."""

    def __init__(self, controller: Controller, scenario: Scenario) -> None:
        self._controller, self._scenario = controller, scenario
        self._seen: list[RolloutLog] = []

    def observe(self, step: ControlStep) -> None:
        """Records a control step."""
        plant, outcome = step.after.plant, step.outcome
        seen = RolloutLog(
            velocity=forward_and_yaw(plant),
            command=step.before.command.velocity,
            power=joint_power(self._controller, self._scenario, plant, step.after.memory.action),
            action=step.action,
            expert_acts=step.output.expert_acts,
            reward=outcome.reward,
            plain_reward=outcome.plain_reward,
            served_dwell=outcome.served_dwell,
            failures=outcome.failures,
        )
        self._seen.append(seen)
        self.done = bool(step.fallen.all())

    def rollout(self, n_steps: int) -> RolloutLog:
        """Returns the log of an episode of `n_steps`."""
        return RolloutLog.stacked(self._seen, axis=0).padded(n_steps)


class Observations(Observer):
    """Records the observations before each control step."""

    def __init__(self) -> None:
        self._rows: list[Array] = []

    def observe(self, step: ControlStep) -> None:
        """Records a control step."""
        self._rows.append(step.observation)

    @property
    def array(self) -> Array:
        """Observations (T, n, n_obs)."""
        return np.array(self._rows)


def forward_and_yaw(plant: Array) -> Array:
    """Returns forward speed and yaw rate in the trunk's frame (..., 2; m/s, rad/s)."""
    linear, angular = kinematics.base_velocity(plant)
    return np.stack([linear[..., 0], angular[..., 2]], axis=-1)


def joint_power(controller: Controller, scenario: Scenario, plant: Array, action: Array) -> Array:
    """Returns the joints' absolute power (...; W) for plants (..., 37) and actions (..., 12)."""
    robot, velocity = controller.robot, plant[..., quadruped.JOINT_VELOCITY]
    law = scenario.joint_law(controller)
    position = plant[..., quadruped.JOINT_POSITION]
    torque = law.torque(robot, action=action, position=position, velocity=velocity)
    return np.abs(torque * velocity).sum(axis=-1)
