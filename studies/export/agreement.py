"""Comparison of an exported controller with Python, on the same sensors and in a closed loop."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task import TaskState
from glassgait.models import GRAVITY
from glassgait.models.control import ControlStep, Sensors
from glassgait.models.errors import InputError
from glassgait.models.export.binding import LoadedController
from glassgait.models.policies.controller import Controller, estimator_in_loop
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands, sound_command
from glassgait.models.task.gait import STANCES, Gait
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.studies.common.episode import ControlStep as EpisodeStep
from glassgait.studies.common.episode import Observer, episode

TOLERANCE = 1e-6
"""Greatest difference of a joint target (rad) between Python and C in double precision."""

COMMAND_STEPS = 50  # control steps between two commands of random sequences

SEQUENCE_STEPS = 500
"""Control steps of a sequence; each begins with a controller in its initial state."""

UNLIMITED = Scenario(limit_targets=False)
"""The nominal scenario, except that joints follow any target."""


class Moment(NamedTuple):
    sensors: Sensors
    command: Command


class Agreement(NamedTuple):
    steps: int
    target: float  # greatest difference of a joint target (rad)
    machine: int  # control steps at which the machine's state, iterations or age differ
    changes: int


def agreement_table(
    gait: Gait,
    controller: Controller,
    compiled: LoadedController,
    n_steps: int,
    seed: int,
    *,
    exact: bool = True,
) -> pd.DataFrame:
    """Compares C and Python on recorded and on random sensors: a row and half the steps each."""
    # Recorded sensors are those of normal use; random ones may reach any state.
    recorded = (n_steps + 1) // 2
    sequences = {
        "recorded": recorded_sequences(gait, controller, recorded, seed),
        "random": random_sequences(controller.robot, gait, n_steps - recorded, seed),
    }
    agreements = {
        name: compare_controllers(gait, controller, compiled, each)
        for name, each in sequences.items()
    }

    # Single precision differs by rounding.
    for each in agreements.values():
        if exact and (not each.target <= TOLERANCE or each.machine):
            raise InputError(
                f"export: a joint target of C differs from Python's by {each.target:.2g} rad, and "
                f"the machine at {each.machine} of {each.steps} steps; report this fault"
            )
    return pd.DataFrame([{"sensors": name, **row._asdict()} for name, row in agreements.items()])


def compare_controllers(
    gait: Gait,
    controller: Controller,
    compiled: LoadedController,
    sequences: Sequence[Sequence[Moment]],
) -> Agreement:
    # Make the control step in Python. Like the C file, it has everything except the policy.
    controller.refuse_other_machine(gait)
    control = ControlStep(
        controller.robot,
        RewardMachine(gait),
        controller.joint_law,
        estimator_in_loop(controller),
        controller.policy.layout.imu,
    )

    # Take the same steps in both, each with its memory.
    greatest, n_different, changes = 0.0, 0, 0
    for sequence in sequences:
        memory, c_memory, state = None, compiled.initial(), None
        for sensors, command in sequence:
            sound = sound_command(gait, command)
            targets, memory = control.step(memory, sensors, sound, controller.policy)
            step = compiled.step(c_memory, sensors, command)
            c_memory = step.memory
            greatest = float(np.maximum(greatest, np.abs(targets - step.targets).max()))
            machine = tuple(map(int, memory.machine))
            c_machine = tuple(c_memory[name] for name in ("state", "iterations", "age"))
            n_different += machine != c_machine
            changes += state not in (None, machine[0])
            state = machine[0]
    return Agreement(sum(map(len, sequences)), greatest, n_different, changes)


def random_sequences(robot: Robot, gait: Gait, n_steps: int, seed: int) -> list[list[Moment]]:
    """Draws random sensors; in every other step, feet fire a transition of the gait."""
    generator = np.random.default_rng(seed)
    counts = [min(SEQUENCE_STEPS, n_steps - k) for k in range(0, n_steps, SEQUENCE_STEPS)]
    return [list(_random_moments(robot, gait, count, generator)) for count in counts]


def _random_moments(
    robot: Robot, gait: Gait, count: int, generator: np.random.Generator
) -> Iterator[Moment]:
    # Without transitions, feet touch at random.
    tables = np.array([edge.when.table for edge in gait.transitions] or [np.ones(len(STANCES))])
    for step in range(count):
        if step % COMMAND_STEPS == 0:
            drawn = sample_commands(gait, 1, generator)
            command = Command(drawn.velocity[0], drawn.dwell[0])
        touching = np.zeros(quadruped.N_LEGS, dtype=bool)
        if step % 2:
            codes = np.flatnonzero(tables[generator.integers(len(tables))])
            touching = STANCES[generator.choice(codes)]
        position = generator.uniform(robot.lower_limits, robot.upper_limits)
        velocity = generator.uniform(-robot.velocity, robot.velocity)
        turning, change, down = generator.normal(size=(3, 3))
        down /= np.linalg.norm(down)
        imu = np.concatenate([turning, CONTROL_PERIOD * GRAVITY * (change - down), down])
        yield Moment(Sensors(position, velocity, touching, imu), command)


def recorded_sequences(
    gait: Gait, controller: Controller, n_steps: int, seed: int
) -> list[list[Moment]]:
    """Records the sensors of robots that the controller moves, in the nominal scenario."""
    steps = recorded_steps(gait, controller, n_steps, seed)
    return list(map(list, zip(*(_moments(step.before) for step in steps), strict=True)))


def recorded_steps(
    gait: Gait, controller: Controller, n_steps: int, seed: int
) -> list[EpisodeStep]:
    """Records control steps of robots that walk about `SEQUENCE_STEPS` each."""
    n_robots = max(1, round(n_steps / SEQUENCE_STEPS))
    recorded = _Steps()
    episode(
        gait,
        controller,
        UNLIMITED,
        n_robots=n_robots,
        n_steps=n_steps // n_robots,
        seed=seed,
        observers=[recorded],
        when_fallen="go on",
    )
    return recorded.steps


class _Steps(Observer):
    def __init__(self) -> None:
        self.steps: list[EpisodeStep] = []

    def observe(self, step: EpisodeStep) -> None:
        self.steps.append(step)


def _moments(state: TaskState) -> Iterator[Moment]:
    for position, speed, touching, imu, velocity, dwell in zip(
        *state.sensors(), *state.command, strict=True
    ):
        yield Moment(Sensors(position, speed, touching, imu), Command(velocity, dwell))
