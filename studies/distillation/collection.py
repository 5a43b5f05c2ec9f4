"""Collecting what the expert would do in the states that expert and student visit together."""

from dataclasses import replace

import numpy as np

from glassgait.diagrams.commands import DrawnCommands
from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, alone, refuse_other_machine
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy, first_not_finite
from glassgait.models.robots import quadruped
from glassgait.models.task import COMMAND_STEPS
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import (
    BoolArray,
    ControlStep,
    Episode,
    Event,
    IntArray,
    Observer,
    World,
    episode,
)
from glassgait.studies.distillation.dataset import Dataset


def collect(
    gait: Gait,
    controller: AlternatingController,
    *,
    episodes: range,
    n_steps: int,
    worlds: DomainRandomization | Scenario,
    generator: np.random.Generator,
    speeds: Array | None = None,
) -> Dataset:
    """Rolls out the episodes of one round at once (paper, Algorithm 1, lines 8 to 18).

    Commands are drawn over the gait's range and change every 10 s, but for forward speeds that are
    named: they stay. A robot that falls starts again, its episode going on.

    Args:
        controller: The expert, whose actions are the samples' labels, and the student.
        episodes: Numbers of the episodes, counted from 1.
        n_steps: Control steps of each.
        worlds: The worlds, of which every round draws some anew; or one, but for its commands.
        generator: Source of randomness.
        speeds: Forward speeds that episodes cycle through (m/s), the first episode with the first.

    Raises:
        InputError: if a sample is not finite, or a policy was made for another machine.
    """
    refuse_other_machine(controller, gait)
    n, numbers = len(episodes), np.array(episodes)
    if isinstance(worlds, Scenario):
        world: Scenario | World = replace(worlds, command=DrawnCommands())
    else:
        law, robot = controller.joint_law, controller.robot
        drawn = worlds.stations(robot, generator, law)
        stations = [drawn[i] for i in generator.permutation(len(drawn))[:n]]
        task = TaskConfig(
            gait,
            worlds.randomization,
            joint_law=replace(law, gains=worlds.station.gains(robot, law)),
            robot=robot,
            observes_imu=controller.expert.layout.imu,
        )
        world = World(task, make_physics(robot, *stations))
    events = []
    if speeds is not None:
        events = [_commanding(gait, speeds[(numbers - 1) % len(speeds)], generator)]
    samples = _Samples(controller.expert)
    episode(
        gait,
        controller,
        world,
        n_robots=n,
        n_steps=n_steps,
        seed=generator,
        observers=[samples],
        events=events,
        when_fallen="restart",
    )
    return samples.dataset(numbers)


def _commanding(gait: Gait, speeds: Array, generator: np.random.Generator) -> Event:
    """Returns what keeps each robot's forward speed (n,; m/s), and draws the rest every 10 s."""
    turns = None

    def command(running: Episode, _: BoolArray) -> None:
        nonlocal turns
        if turns is None or running.step % COMMAND_STEPS == 0:
            turns = sample_commands(gait, len(speeds), generator)
        velocity = np.stack([speeds, turns.velocity[:, 1]], axis=1)
        # A robot that starts again draws a command of its own.
        running.simulator.set_command(Command(velocity, turns.dwell))

    return Event(None, None, command)


def collect_alone(
    gait: Gait, expert: NeuralPolicy, policy: Policy, *, n_robots: int, n_steps: int, seed: int
) -> Dataset:
    """Rolls a policy out alone in the training scenario; a robot that falls starts again.

    Commands are drawn over the gait's range.

    Args:
        expert: The expert; its estimator observes for the policy.
        policy: The policy that acts: a student, or the expert.
        n_steps: Control steps of each.
        seed: Seed of initial states, commands and noise.

    Returns:
        What the robots observed and the expert would do (n_robots · n_steps samples), each robot
        an episode.

    Raises:
        InputError: if a sample is not finite.
    """
    return collect(
        gait,
        alone(policy, expert),
        episodes=range(1, n_robots + 1),
        n_steps=n_steps,
        worlds=Scenario(),
        generator=np.random.default_rng(seed),
    )


class _Samples(Observer):
    """Records what is observed, and what the expert would do."""

    def __init__(self, expert: Policy) -> None:
        self._expert = expert
        self._observations: list[Array] = []
        self._labels: list[Array] = []

    def observe(self, step: ControlStep) -> None:
        # Where the expert acts, what it does is known.
        by_expert = step.output.expert_acts.all()
        label = step.output.action if by_expert else self._expert(step.observation)
        _refuse_not_finite(self._expert, step.step, step.observation, label)
        self._observations.append(step.observation)
        self._labels.append(label)

    def dataset(self, episodes: IntArray) -> Dataset:
        """Returns the samples, one episode after the other."""
        observations, labels = (
            np.swapaxes(rows, 0, 1).reshape(len(episodes) * len(rows), -1)
            for rows in (self._observations, self._labels)
        )
        return Dataset(observations, labels, np.repeat(episodes, len(self._labels)))


def _refuse_not_finite(expert: Policy, step: int, observation: Array, label: Array) -> None:
    found = first_not_finite(np.concatenate([observation, label], axis=1))
    if found is not None:
        actions = (f"the action of {joint}" for joint in quadruped.JOINTS)
        name = (*expert.observation_names, *actions)[found[1]]
        raise InputError(
            f"expert: {name} is not finite at control step {step} of its episode; train it again, "
            "or name the run of another with --source"
        )
