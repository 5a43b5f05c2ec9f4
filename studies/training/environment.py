"""The batch simulator as an environment for PPO: observation groups, scaled rewards, resets."""

from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict import TensorDict

from glassgait.diagrams.batch import BatchSimulator, BatchStep
from glassgait.diagrams.domain_randomization import at_hardship
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.estimation.sensors import ImuReading, measure_imu
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD, EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ANGULAR_VELOCITY_SCALE
from glassgait.studies.training.config import TrainingConfig

OBSERVATION_GROUPS = {
    "actor": ["proprioception", "estimate"],
    "critic": ["proprioception", "body_state", "privileged"],
}
"""Observation groups of the actor and of the critic, which observes true values."""


def actor_observations(observations: TensorDict) -> torch.Tensor:
    """Returns the actor's observations (n, n_observations) from observation groups (n, ...)."""
    return torch.cat([observations[group] for group in OBSERVATION_GROUPS["actor"]], dim=1)


class TrainingStep(NamedTuple):
    """One control step of all robots (n, ...), after the resets.

    Rewards are scaled. Episodes in `time_outs` reached their greatest length; they are in `dones`.
    """

    observations: TensorDict
    rewards: torch.Tensor
    dones: torch.Tensor
    time_outs: torch.Tensor
    task: BatchStep


class Environment:
    """The robots of a batch simulator; a finished episode restarts in the same step."""

    def __init__(
        self,
        config: TrainingConfig,
        gait: Gait,
        estimator: Callable[[torch.Tensor], torch.Tensor] | Odometry,
        generator: np.random.Generator,
        *,
        observes_imu: bool = False,
    ) -> None:
        """Makes the robots; a network estimates body states (n, 7) from proprioception (n, k)."""
        self._reward_scale = config.ppo.reward_scale
        self._estimator, self.generator = estimator, generator

        # Draw a station for each group, and the same stations for early updates, without Drake.
        worlds, robot, curriculum = config.worlds, load_robot(config.robot), config.curriculum
        early = replace(worlds, mujoco_share=1.0).stations(robot, deepcopy(generator))
        stations = worlds.stations(robot, generator)
        self._stations, self._mujoco_updates = (stations, early), curriculum.mujoco_updates
        self._ground = curriculum.initial_hardship, self._mujoco_updates > 0
        self.simulator = BatchSimulator(
            TaskConfig(
                gait,
                worlds.randomization,
                weights=config.weights,
                limits=config.limits,
                joint_law=config.joint_law,
                robot=robot,
                observes_imu=observes_imu,
            ),
            make_physics(robot, *self._scaled_stations()),
            n_robots=config.n_robots,
            generator=generator,
            # A learned estimator is evaluated in `observe`; the reward machine reads true heights.
            estimator=estimator if isinstance(estimator, Odometry) else None,
            difficulty=curriculum.initial_difficulty,
        )
        self.simulator.push_share = curriculum.initial_hardship

        # The critic observes each robot's payload and motor strength.
        bodies = [[station.payload, station.motor_strength] for station in stations]
        self._body = self.simulator.physics.per_robot(bodies, config.n_robots)

        # Spread the ends of the first episodes, so that every update has robots of all ages.
        ages = generator.integers(EPISODE_STEPS, size=config.n_robots)
        self.simulator.restore(self.simulator.state._replace(steps=ages))

    def change_ground(self, n_updates: int) -> None:
        """Draws new frictions for all groups, and scales the ground by the current hardship."""
        self.simulator.resample_friction()
        self._set_ground(self.simulator.push_share, n_updates < self._mujoco_updates)

    def _set_ground(self, hardship: float, is_early: bool) -> None:
        """Replaces the physics if the ground or an engine changes."""
        before, self._ground = self._scaled_stations(), (hardship, is_early)
        if (stations := self._scaled_stations()) != before:
            self.simulator.change_ground(make_physics(self.simulator.task.robot, *stations))

    def _scaled_stations(self) -> list[StationConfig]:
        hardship, is_early = self._ground
        return at_hardship(self._stations[is_early], hardship)

    def observe(self) -> TensorDict:
        """Returns the observation groups of all robots."""
        proprioception = _tensor(self.simulator.proprioception())
        if isinstance(self._estimator, Odometry):
            estimate = _tensor(self.simulator.state.memory.estimate)
        else:
            # The estimator is trained from stored steps, not through the actor.
            with torch.no_grad():
                estimate = self._estimator(proprioception)
        return TensorDict(
            {
                "proprioception": proprioception,
                "estimate": estimate,
                "body_state": _tensor(self.simulator.body_state()),
                "privileged": _tensor(self._privileged()),
            },
            batch_size=[len(proprioception)],
        )

    def step(self, actions: torch.Tensor) -> TrainingStep:
        """Holds actions (n, 12) for one control step and resets robots with finished episodes."""
        # A sink of the reward machine ends an episode too, since it gives no more reward.
        simulator = self.simulator
        step = simulator.step(actions.numpy().astype(float))
        in_sink = simulator.machine.in_sink(simulator.state.memory.machine.state)
        failed = step.terminated | in_sink
        ended = failed | step.truncated
        simulator.reset(np.flatnonzero(ended))

        # For episodes that reached their greatest length, PPO estimates the further return.
        return TrainingStep(
            observations=self.observe(),
            rewards=_tensor(step.reward * self._reward_scale),
            dones=torch.from_numpy(ended),
            time_outs=torch.from_numpy(step.truncated & ~failed),
            task=step,
        )

    def play(
        self, act: Callable[[TensorDict], torch.Tensor], n_steps: int
    ) -> Iterator[tuple[TensorDict, TrainingStep]]:
        """Yields pairs of the observations before a control step, and the step."""
        observations = self.observe()
        for _ in range(n_steps):
            step = self.step(act(observations))
            yield observations, step
            observations = step.observations

    def _privileged(self) -> Array:
        s = self.simulator.state
        _, angular = kinematics.base_velocity(s.plant)
        # The true direction of gravity; `gravity_direction` below is relative to sloped ground.
        gravity = []
        if isinstance(self._estimator, Odometry):
            velocity = s.plant[:, quadruped.LINEAR_VELOCITY]
            reading = measure_imu(s.plant, velocity, self.simulator.gravity)
            gravity.append(ImuReading.of(reading).gravity)
        return np.concatenate(
            [
                *gravity,
                kinematics.gravity_direction(s.plant[:, quadruped.QUATERNION]),
                ANGULAR_VELOCITY_SCALE * angular,
                s.touching,
                self.simulator.friction_of_robots()[:, None],
                self._body,
                s.latency[:, None] / CONTROL_PERIOD,
                np.full((len(s.plant), 1), self.simulator.difficulty),
            ],
            axis=1,
        )

    def to_arrays(self) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Returns the state for a checkpoint: named arrays, and values that JSON can hold."""
        arrays = dict(self.simulator.state.as_arrays(), friction=self.simulator.friction)
        return arrays, {
            "difficulty": self.simulator.difficulty,
            "hardship": self.simulator.push_share,
            "ground": self._ground,
            "generator": self.generator.bit_generator.state,
        }

    def restore(self, arrays: dict[str, np.ndarray], values: dict[str, Any]) -> None:
        """Continues from the results of `to_arrays`."""
        self._set_ground(*values["ground"])
        self.simulator.restore(self.simulator.state.with_arrays(arrays))
        self.simulator.restore_friction(arrays["friction"])
        self.simulator.difficulty = values["difficulty"]
        self.simulator.push_share = values["hardship"]
        self.generator.bit_generator.state = values["generator"]


def _tensor(array: Array) -> torch.Tensor:
    return torch.from_numpy(np.asarray(array, dtype=np.float32))
