"""Collection of the expert's actions in the states that expert and student visit."""

from dataclasses import replace

import numpy as np

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import DrawnCommands
from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.task import COMMAND_STEPS
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import (
    ControlStep,
    Event,
    IntArray,
    Observer,
    PreparedTask,
    episode,
)
from glassgait.studies.distillation.dataset import Dataset


def collect(
    gait: Gait,
    controller: Controller,
    *,
    episodes: range,
    n_steps: int,
    worlds: DomainRandomization | Scenario,
    generator: np.random.Generator,
    speeds: Array | None = None,
    memories: bool = False,
) -> Dataset:
    """Rolls out the episodes of one round as a batch (paper, Algorithm 1, lines 8 to 18).

    Commands are drawn from the gait's range and change every 10 s; given forward speeds do not
    change. A robot that falls restarts within its episode.

    Args:
        episodes: Numbers of the episodes, counted from 1.
        speeds: Forward speeds (m/s) that the episodes cycle through, beginning at episode 1.
        memories: Record what the expert acts on (see `Policy.remember`) instead of observations.
    """
    controller.refuse_other_machine(gait)

    # Use the given scenario, or draw a station for each robot.
    n, numbers = len(episodes), np.array(episodes)
    if isinstance(worlds, Scenario):
        world: Scenario | PreparedTask = replace(worlds, command=DrawnCommands())
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
        world = PreparedTask(task, make_physics(robot, *stations))

    # Roll out, and record.
    speeds = None if speeds is None else speeds[(numbers - 1) % len(speeds)]
    events = [] if speeds is None else [_commanding(gait, speeds, generator)]
    samples = _Samples(controller.expert, memories)
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
    """Returns the event that holds each robot's forward speed (n,; m/s) and draws turn rates."""
    turns = None

    def command(step: int, simulator: BatchSimulator) -> None:
        nonlocal turns
        if turns is None or step % COMMAND_STEPS == 0:
            turns = sample_commands(gait, len(speeds), generator)
        velocity = np.stack([speeds, turns.velocity[:, 1]], axis=1)
        # Set it at every step, since a robot that restarts draws another command.
        simulator.set_command(Command(velocity, turns.dwell))

    return command


class _Samples(Observer):
    """Records observations with the expert's actions."""

    def __init__(self, expert: Policy, memories: bool) -> None:
        self._expert, self._memories = expert, memories
        self._observations: list[Array] = []
        self._labels: list[Array] = []

    def observe(self, step: ControlStep) -> None:
        # The expert's action is known at steps at which it acts.
        by_expert = step.output.expert_acts.all()
        label = step.output.action if by_expert else self._expert(step.output.memory)
        if not (np.isfinite(step.observation).all() and np.isfinite(label).all()):
            raise InputError(
                f"expert: an observation or action is not finite at control step {step.step}; "
                "train the expert again, or name another run with --source"
            )
        self._observations.append(step.output.memory if self._memories else step.observation)
        self._labels.append(label)

    def dataset(self, episodes: IntArray) -> Dataset:
        # Concatenate the episodes.
        observations, labels = (
            np.swapaxes(rows, 0, 1).reshape(len(episodes) * len(rows), -1)
            for rows in (self._observations, self._labels)
        )
        return Dataset(observations, labels, np.repeat(episodes, len(self._labels)))
