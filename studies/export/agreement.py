"""Whether the C of a controller does what Python does: both take the same steps."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_state import TaskState
from glassgait.models.arrays import Array
from glassgait.models.export.binding import MACHINE, N_DAY, LoadedController, Sensors
from glassgait.models.export.reference import PythonController
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.day import REQUESTS
from glassgait.models.task.formula import STANCES
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.imu import GRAVITY
from glassgait.studies.common.episode import (
    ControlStep,
    IntArray,
    Observer,
    episode,
)
from glassgait.studies.common.observers import Observations

COMMAND_STEPS = 50
"""Control steps between two commands of random sequences."""

UNLIMITED = Scenario(limit_targets=False)
"""The training world, in which joints follow any target."""

REQUEST_STEPS = 100
"""Control steps from one request to the next of robots that are recorded (2 s)."""

RANDOM_REQUEST_STEPS = 20
"""Control steps from one request to the next where sensors are drawn at random."""

MODE_STEPS = 100
"""Control steps from one request of a mode to the next, where they are drawn."""

LEANING = 5
"""Every so many random sequences of a day are of robots that lean anyhow."""

SEQUENCE_STEPS = 500
"""Control steps of a sequence; each begins with a controller that was just started."""


MODE = -N_DAY
"""Where the number of the mode stands in what a controller with a day remembers."""

COUNTS = slice(MODE, MODE + 4)
"""Where its mode and its counts of control steps do."""


class Moment(NamedTuple):
    """What a controller reads in a step.

    Attributes:
        sensors: What the robot senses.
        command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded.
        requested: Number of the gait that is to run, of several.
        requested_mode: Number of what the operator requests, of a day.
    """

    sensors: Sensors
    command: Command
    requested: int = 0
    requested_mode: int = 0


@dataclass(frozen=True)
class Agreement:
    """How far two controllers are apart over the same sequences.

    Attributes:
        steps: Control steps that were taken.
        target: Greatest difference of a joint target (rad).
        machine: Control steps at which the machine's state, iterations or age differ.
        changes: Changes of the machine's state.
        gaits: Changes of the gait among them; None where there is only one.
        modes: Control steps at which what is remembered of a day differs; None without one.
        mode_changes: Changes of its mode.
    """

    steps: int
    target: float
    machine: int
    changes: int
    gaits: int | None = None
    modes: int | None = None
    mode_changes: int | None = None


def compare_controllers(
    python: PythonController, compiled: LoadedController, sequences: list[list[Moment]]
) -> Agreement:
    """Lets both take the steps of each sequence, each with its own memory."""
    greatest, apart, changes, gaits, modes, mode_changes = 0.0, 0, 0, 0, 0, 0
    for sequence in sequences:
        ours, theirs = python.initial(), compiled.initial()
        for moment in sequence:
            state, gait = ours[MACHINE][0], compiled.gait_of(ours)
            mode = ours[MODE]
            one = python.step(ours, *moment)
            other = compiled.step(theirs, *moment)
            ours, theirs = one.memory, other.memory
            modes += not np.array_equal(ours[COUNTS], theirs[COUNTS])
            mode_changes += bool(ours[MODE] != mode)
            greatest = max(greatest, float(np.abs(one.targets - other.targets).max()))
            apart += not np.array_equal(ours[MACHINE], theirs[MACHINE])
            changes += bool(ours[MACHINE][0] != state)
            gaits += compiled.gait_of(ours) != gait
    steps = sum(map(len, sequences))
    of_day = (modes, mode_changes) if compiled.has_day else (None, None)
    of_gaits = gaits if compiled.n_gaits > 1 else None
    return Agreement(steps, greatest, apart, changes, of_gaits, *of_day)


def random_sequences(
    robot: Robot, gait: Gait | GaitSwitch, n_steps: int, seed: int
) -> list[list[Moment]]:
    """Draws sensors at random, in sequences of `SEQUENCE_STEPS`, and requests of several gaits.

    Joints are anywhere in their ranges, as fast as they can be; every other stance is one in which
    a transition of the gait fires, or of one of the gaits. The trunk leans and turns anyhow.
    """
    generator, of_trunk = np.random.default_rng(seed), np.random.default_rng([seed, 1])
    machine = gait.gait if isinstance(gait, GaitSwitch) else gait
    tables = np.array([transition.when.table for transition in machine.transitions])
    counts = [min(SEQUENCE_STEPS, n_steps - k) for k in range(0, n_steps, SEQUENCE_STEPS)]
    sequences = [
        list(_random_moments(robot, machine, tables, random_readings(own, of_trunk), generator))
        for own in counts
    ]
    if isinstance(gait, Gait):
        return sequences
    requested = drawn_requests(gait, len(sequences), SEQUENCE_STEPS, RANDOM_REQUEST_STEPS, seed)
    return [
        [moment._replace(requested=int(asked)) for moment, asked in zip(own, row, strict=False)]
        for own, row in zip(sequences, requested.T, strict=True)
    ]


def with_requested_modes(sequences: list[list[Moment]], seed: int) -> list[list[Moment]]:
    """Draws what the operator requests, another thing from time to time.

    Trunks are held nearly level in all but a few sequences: a lean would end the day's others.
    """
    generator = np.random.default_rng([seed, 2])
    return [
        [
            _level(moment)._replace(requested_mode=int(asked)) if (number + 1) % LEANING else moment
            for moment, asked in zip(own, _drawn_modes(len(own), generator), strict=True)
        ]
        for number, own in enumerate(sequences)
    ]


def _drawn_modes(count: int, generator: np.random.Generator) -> IntArray:
    asked = generator.integers(len(REQUESTS), size=-(-count // MODE_STEPS))
    return np.repeat(asked, MODE_STEPS)[:count]


def _level(moment: Moment) -> Moment:
    sensors = moment.sensors
    assert sensors.imu is not None
    imu = np.concatenate([sensors.imu[:6] * [0.5, 0.5, 0.5, 1, 1, 1], [0.0, 0.0, -1.0]])
    slow = replace(sensors, joint_velocity=0.1 * sensors.joint_velocity, imu=imu)
    return moment._replace(sensors=slow)


def random_readings(count: int, generator: np.random.Generator) -> Array:
    """Draws readings of an IMU (count, 9) of robots that lean and turn anyhow."""
    turning, change, down = generator.normal(size=(3, count, 3))
    down /= np.sqrt(np.sum(np.square(down), axis=1, keepdims=True))
    change *= CONTROL_PERIOD * GRAVITY
    return np.concatenate([turning, change - CONTROL_PERIOD * GRAVITY * down, down], axis=1)


def _random_moments(
    robot: Robot, gait: Gait, tables: Array, readings: Array, generator: np.random.Generator
) -> Iterator[Moment]:
    for step, imu in enumerate(readings):
        if step % COMMAND_STEPS == 0:
            drawn = sample_commands(gait, 1, generator)
            command = Command(drawn.velocity[0], drawn.dwell[0])
        if step % 2:
            codes = np.flatnonzero(tables[generator.integers(len(tables))])
            touching = STANCES[generator.choice(codes)]
        else:
            touching = np.zeros(quadruped.N_LEGS, dtype=bool)
        position = generator.uniform(robot.lower_limits, robot.upper_limits)
        velocity = generator.uniform(-robot.velocity, robot.velocity)
        yield Moment(Sensors(position, velocity, touching, imu), command)


def recorded_sequences(
    gait: Gait, controller: AlternatingController, n_steps: int, seed: int
) -> list[list[Moment]]:
    """Records what robots sense that the controller moves, in the training world."""
    n_robots = max(1, round(n_steps / SEQUENCE_STEPS))
    own_steps = n_steps // n_robots
    recorded = RecordedMoments(n_robots)
    episode(
        gait,
        controller,
        UNLIMITED,
        n_robots=n_robots,
        n_steps=own_steps,
        seed=seed,
        observers=[recorded],
        when_fallen="go on",
    )
    return recorded.sequences


def drawn_requests(
    switch: GaitSwitch, n_robots: int, n_steps: int, every: int, seed: int
) -> IntArray:
    """Draws the numbers of the gaits that robots are asked for (n_steps, n_robots).

    The first gait is asked for at first, and from time to time another one than before.
    """
    generator = np.random.default_rng(seed)
    n_gaits, n_requests = len(switch.gaits), -(-n_steps // every)
    onward = generator.integers(1, max(n_gaits, 2), size=(n_requests, n_robots))
    onward[0] = 0
    requested = np.cumsum(onward, axis=0) % n_gaits
    return np.repeat(requested, every, axis=0)[:n_steps]


class RecordedMoments(Observer):
    """Records what each robot senses.

    Attributes:
        sequences: Moments of each robot.
    """

    def __init__(
        self,
        n_robots: int,
        requested: IntArray | None = None,
        requested_modes: IntArray | None = None,
    ) -> None:
        self.sequences: list[list[Moment]] = [[] for _ in range(n_robots)]
        self._requested, self._requested_modes = requested, requested_modes

    def observe(self, step: ControlStep) -> None:
        """Records a control step."""
        asked = self._requested
        # What is requested in a step is read in the next one.
        now = None if asked is None or step.step == 0 else asked[step.step - 1]
        for i, moment in enumerate(moments(step.before, now)):
            # A mode is requested before robots are observed.
            mode = 0 if self._requested_modes is None else int(self._requested_modes[step.step, i])
            self.sequences[i].append(moment._replace(requested_mode=mode))


def recorded_observations(
    gait: Gait, controller: AlternatingController, n_robots: int, n_steps: int, seed: int
) -> Array:
    """Records what robots observe (m, n) that the controller moves in the training world."""
    observations = Observations()
    episode(
        gait,
        controller,
        UNLIMITED,
        n_robots=n_robots,
        n_steps=n_steps,
        seed=seed,
        observers=[observations],
        when_fallen="go on",
    )
    return np.concatenate(observations.array)


def moments(state: TaskState, requested: IntArray | None = None) -> Iterator[Moment]:
    """Returns what each robot senses and is asked for in a state; see `Moment`."""
    gaits = np.zeros(len(state.steps), dtype=np.int64) if requested is None else requested
    measured = joint_readings(state.plant, state.joint_noise)
    for row, touching, imu, velocity, dwell, gait in zip(
        measured, state.sensed, state.imu[:, -1], *state.command, gaits, strict=True
    ):
        position, speed = np.split(row, 2)
        yield Moment(Sensors(position, speed, touching, imu), Command(velocity, dwell), int(gait))


def joint_readings(plant: Array, noise: Array) -> Array:
    """Returns what the joints' sensors measure: positions, then velocities (n, 24; rad, rad/s)."""
    parts = [plant[:, quadruped.JOINT_POSITION], plant[:, quadruped.JOINT_VELOCITY]]
    return np.concatenate(parts, axis=1) + noise
