"""The batch simulator as PPO sees it: observation groups, scaled rewards and resets."""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
import torch
from tensordict import TensorDict

from glassgait.diagrams.batch import BatchSimulator, BatchStep
from glassgait.diagrams.domain_randomization import at_hardship
from glassgait.diagrams.physics import make_physics
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
"""Observations of the actor and the critic, which is not deployed and sees the truth."""


def observed_by_actor(observations: TensorDict) -> torch.Tensor:
    """Returns the actor's observations (n, n_observations) from observation groups (n, ...)."""
    return torch.cat([observations[group] for group in OBSERVATION_GROUPS["actor"]], dim=1)


class TrainingStep(NamedTuple):
    """One control step of all robots (n, ...), after the resets.

    Rewards are scaled; episodes in `time_outs`, which are `dones` too, ended by their length.
    """

    observations: TensorDict
    rewards: torch.Tensor
    dones: torch.Tensor
    time_outs: torch.Tensor
    task: BatchStep


class Environment:
    """The robots of one batch simulator; an episode that ends starts anew in the same step."""

    def __init__(
        self,
        config: TrainingConfig,
        gait: Gait,
        estimator: Callable[[torch.Tensor], torch.Tensor] | Odometry,
        generator: np.random.Generator,
        *,
        observes_imu: bool = False,
    ) -> None:
        """Makes the robots; a network estimates trunk and feet (n, 7) by proprioception (n, k)."""
        self._reward_scale = config.ppo.reward_scale
        self._estimator, self.generator = estimator, generator

        # A station for each group; its ground is laid at the hardship of the curriculum.
        worlds, robot = config.worlds, load_robot(config.robot)
        self._stations = stations = worlds.stations(robot, generator)
        self._ground_hardship = config.curriculum.initial_hardship
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
            make_physics(robot, *at_hardship(stations, self._ground_hardship)),
            n_robots=config.n_robots,
            generator=generator,
            # A network that learns estimates here, and the reward machine reads true heights.
            estimator=estimator if isinstance(estimator, Odometry) else None,
            difficulty=config.curriculum.initial_difficulty,
        )
        self.simulator.push_share = config.curriculum.initial_hardship

        # The critic observes each robot's load and motors.
        members = self.simulator.physics.members(config.n_robots)
        self._body = np.repeat(
            [[station.payload, station.motor_strength] for station in stations],
            [len(group) for group in members],
            axis=0,
        )

        # Spread the ends of the first episodes, so that updates see all ages at once.
        ages = generator.integers(EPISODE_STEPS, size=config.n_robots)
        self.simulator.restore(self.simulator.state._replace(steps=ages))

    def draw_worlds(self) -> None:
        """Draws new frictions for all groups, and lays ground of the current hardship."""
        self.simulator.resample_friction()
        self._lay_ground(self.simulator.push_share)

    def _lay_ground(self, hardship: float) -> None:
        """Scales the ground; the physics stay as they are where that changes nothing."""
        now, then = (at_hardship(self._stations, h) for h in (self._ground_hardship, hardship))
        self._ground_hardship = hardship
        if then != now:
            self.simulator.change_ground(make_physics(self.simulator.task.robot, *then))

    def observe(self) -> TensorDict:
        """Returns the observation groups of all robots."""
        proprioception = _tensor(self.simulator.proprioception())
        if isinstance(self._estimator, Odometry):
            estimate = _tensor(self.simulator.state.memory.estimate)
        else:
            # The estimator learns from stored steps, not through the actor.
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
        """Holds actions (n, 12) for one control step and resets the robots that ended."""
        # Step, and let an episode end in a sink of the reward machine, too.
        simulator = self.simulator
        step = simulator.step(actions.numpy().astype(float))
        # Nothing more can be earned there.
        in_sink = simulator.machine.in_sink(simulator.state.memory.machine.state)
        worthless = step.terminated | in_sink
        ended = worthless | step.truncated
        simulator.reset(np.flatnonzero(ended))

        # Robots that ended at their length could have earned more, which PPO accounts for.
        return TrainingStep(
            observations=self.observe(),
            rewards=_tensor(step.reward * self._reward_scale),
            dones=torch.from_numpy(ended),
            time_outs=torch.from_numpy(step.truncated & ~worthless),
            task=step,
        )

    def play(
        self, act: Callable[[TensorDict], torch.Tensor], n_steps: int
    ) -> Iterator[tuple[TensorDict, TrainingStep]]:
        """Yields control steps, each after the observations that its actions answer."""
        observations = self.observe()
        for _ in range(n_steps):
            step = self.step(act(observations))
            yield observations, step
            observations = step.observations

    def _privileged(self) -> Array:
        s = self.simulator.state
        _, angular = kinematics.base_velocity(s.plant)
        # The true direction of gravity, which differs from the ground's on slopes.
        leaning = []
        if isinstance(self._estimator, Odometry):
            velocity = s.plant[:, quadruped.LINEAR_VELOCITY]
            reading = measure_imu(s.plant, velocity, self.simulator.gravity)
            leaning.append(ImuReading.of(reading).gravity)
        return np.concatenate(
            [
                *leaning,
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
            "ground_hardship": self._ground_hardship,
            "generator": self.generator.bit_generator.state,
        }

    def restore(self, arrays: dict[str, np.ndarray], values: dict[str, Any]) -> None:
        """Continues from what `to_arrays` returned."""
        self._lay_ground(values["ground_hardship"])
        self.simulator.restore(self.simulator.state.with_arrays(arrays))
        self.simulator.restore_friction(arrays["friction"])
        self.simulator.difficulty = values["difficulty"]
        self.simulator.push_share = values["hardship"]
        self.generator.bit_generator.state = values["generator"]


def _tensor(array: Array) -> torch.Tensor:
    return torch.from_numpy(np.asarray(array, dtype=np.float32))
