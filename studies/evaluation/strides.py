"""The stride map: from one entry of the reward machine's first state to the next."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_state import TaskState
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.heading_frame import COORDINATES, from_heading_frame
from glassgait.models.task.command import Command
from glassgait.models.task.contact import ContactTrust, sense_feet
from glassgait.models.task.gait import Gait
from glassgait.models.task.odometry import Odometry, OdometryState
from glassgait.models.task.reward_machine import MachineState
from glassgait.studies.common.episode import (
    BoolArray,
    ControlStep,
    Episode,
    Event,
    Observer,
    World,
    episode,
)
from glassgait.studies.common.loop_state import (
    NAMES,
    ODOMETRY_NAMES,
    ODOMETRY_UNITS,
    UNITS,
    loop_state,
)
from glassgait.studies.common.observers import entered
from glassgait.studies.evaluation.pushing import horizontal

SPEEDS = slice(COORDINATES.index("forward speed"), COORDINATES.index("lateral speed") + 1)
"""Where the trunk's horizontal speeds stand."""

MOST_STEPS = 100
"""Control steps after which a robot that has not come back has no image."""

FIRST_STEPS = 150
"""Control steps from standing until a stride may begin."""

LONG_AGO = 1000
"""Control steps since the episode's start, for the machine: all that it excuses is over."""


@dataclass(frozen=True)
class Stride:
    """Where robots are one stride later.

    Attributes:
        images: Coordinates (n, d), in units; NaN for a robot that fell or did not come back.
        n_steps: Control steps that it took (n,); 0 for those.
    """

    images: Array
    n_steps: NDArray[np.int64]


class StrideMap:
    """Strides of one policy under several commands, in a world without noise.

    Coordinates, counted in units, describe a robot in the instant in which it enters the machine's
    first state: 45, and 15 more where odometry is in the loop.

    Attributes:
        command: Velocities (m, 2) and dwells (m,) of m problems.
        controller: The controller.
        names: What the coordinates are (d).
        units: What each is counted in (d).
    """

    def __init__(self, gait: Gait, controller: AlternatingController, command: Command) -> None:
        """
        Args:
            gait: The gait.
            controller: The controller, of one policy.
            command: Velocities (m, 2) and dwells (m,) of m problems.
        """
        self.command = command
        self._gait, self.controller = gait, controller
        self._odometry = isinstance(controller.estimator, Odometry)
        self.names = (*NAMES, *ODOMETRY_NAMES) if self._odometry else NAMES
        self.units = np.concatenate([UNITS, ODOMETRY_UNITS]) if self._odometry else UNITS
        scenario = replace(Scenario(), sensor_noise=0.0, command=FixedCommand(0.0, 0.0, 8))
        self._world = World.of(gait, scenario, controller)
        self._entered = gait.states.index(gait.initial)

    @property
    def is_stepwise(self) -> bool:
        """Whether the policy is constant but for jumps, so that the map's derivatives are void."""
        return self.controller.policy.capabilities.stepwise

    def first_points(self) -> Array:
        """Lets a robot of each command start from standing, until it enters after some seconds.

        Returns:
            Coordinates (m, d); NaN where it fell or never entered.
        """
        n = len(self.command.dwell)
        standing = np.tile(kinematics.standing_state(self.controller.robot), (n, 1))

        def stand(running: Episode, _: BoolArray) -> None:
            running.simulator.start_at(standing, self.command)

        return self._until_entered(n, stand, FIRST_STEPS).images

    def stride(self, points: Array, problems: NDArray[np.int64]) -> Stride:
        """Takes a stride from each point.

        Args:
            points: Coordinates (n, d), in `units`.
            problems: Which command each robot has (n,).
        """
        sound = np.flatnonzero(np.isfinite(points).all(axis=1))
        images = np.full_like(points, np.nan)
        n_steps = np.zeros(len(points), dtype=np.int64)
        if len(sound):
            done = self._until_entered(
                len(sound), self._entering(points[sound], problems[sound]), not_before=0
            )
            images[sound], n_steps[sound] = done.images, done.n_steps
        return Stride(images, n_steps)

    def __call__(self, points: Array, problems: NDArray[np.int64]) -> Array:
        """Maps points (n, d) to those one stride later."""
        return self.stride(points, problems).images

    def pushed(self, point: Array, step: int, direction: Array, speed: float) -> Array:
        """Takes a stride from one point, with a push of the trunk on the way.

        Args:
            point: Coordinates (d,), of the first command.
            step: Control step of the stride before which the push comes.
            direction: Angles of pushes from straight ahead, to the left (n,; rad).
            speed: What each adds to the trunk's velocity (m/s).

        Returns:
            Coordinates one stride later (n, d); NaN for a robot that did not come back.
        """
        n = len(direction)
        points, problems = np.tile(point, (n, 1)), np.zeros(n, dtype=np.int64)

        def push(running: Episode, _: BoolArray) -> None:
            state = running.simulator.state
            added = horizontal(state.plant, direction, np.full(n, speed))
            running.simulator.restore(state.pushed(added))
            # The next observation shows it.
            running.simulator.set_command(state.command)

        begin = self._entering(points, problems)
        return self._until_entered(n, begin, not_before=0, then=[Event(step, None, push)]).images

    def _entering(
        self, points: Array, problems: NDArray[np.int64]
    ) -> Callable[[Episode, BoolArray], None]:
        """Returns what lets robots begin as they have just entered the machine's first state."""
        n = len(points)
        ends = [len(COORDINATES), len(NAMES)]
        coordinates, action, remembered = np.split(points * self.units, ends, axis=1)
        plant = from_heading_frame(coordinates)
        command = Command(*(values[problems] for values in self.command))
        machine = MachineState(
            state=np.full(n, self._entered),
            iterations=np.zeros(n, dtype=np.int64),
            age=np.full(n, LONG_AGO),
        )
        feet = sense_feet(self.controller.robot, plant, np.zeros((n, quadruped.N_LEGS), dtype=bool))

        def enter(running: Episode, _: BoolArray) -> None:
            simulator = running.simulator
            simulator.start_at(plant, command)
            simulator.restore(
                replace(
                    simulator.state,
                    machine=machine,
                    touching=feet.touching,
                    trust=ContactTrust.begin((n,)).after(feet.touching),
                    action=action,
                    odometry=self._remembered(simulator.state, remembered, feet.touching),
                    # A new command comes at whole multiples of its period, of which 0 is one.
                    steps=np.ones(n, dtype=np.int64),
                )
            )
            # The estimator must observe what was set.
            simulator.set_command(command)

        return enter

    def _remembered(
        self, state: TaskState, coordinates: Array, touching: BoolArray
    ) -> OdometryState:
        """Returns what odometry remembers at coordinates (n, 15)."""
        if not self._odometry:
            return state.odometry
        velocity, footholds = np.split(coordinates, [3], axis=1)
        places = footholds.reshape(-1, quadruped.N_LEGS, 3)
        # By turning alone feet are judged whose sensors are stuck, of which there are none.
        return OdometryState(velocity, places, touching, np.zeros_like(velocity))

    def _until_entered(
        self,
        n: int,
        begin: Callable[[Episode, BoolArray], None],
        not_before: int,
        then: Sequence[Event] = (),
    ) -> Stride:
        images = _Images(n, self._entered, not_before, len(self.units))
        episode(
            self._gait,
            self.controller,
            self._world,
            n_robots=n,
            n_steps=not_before + MOST_STEPS,
            seed=0,
            observers=[images],
            events=[Event(0, None, begin), *then],
        )
        return images.stride


class _Images(Observer):
    """Records where robots enter a state of the machine again, until none is to come.

    Attributes:
        stride: Images and control steps of those that came so far.
    """

    def __init__(self, n_robots: int, state: int, not_before: int, n_coordinates: int) -> None:
        images = np.full((n_robots, n_coordinates), np.nan)
        self.stride = Stride(images, np.zeros(n_robots, dtype=np.int64))
        self._going = np.ones(n_robots, dtype=bool)
        self._state, self._not_before = state, not_before

    def observe(self, step: ControlStep) -> None:
        number, after = step.step + 1, step.after
        self._going &= ~step.outcome.terminated
        came = self._going & entered(step, self._state) & (number > self._not_before)
        if came.any():
            self.stride.images[came] = loop_state(after)[came, : self.stride.images.shape[1]]
            self.stride.n_steps[came] = number
            self._going &= ~came
        self.done = not self._going.any()
