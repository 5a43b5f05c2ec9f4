"""The stride map: from one entry of the reward machine's first state to the next."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.controller import AlternatingController, estimator_in_loop
from glassgait.models.robots import kinematics, quadruped, robot
from glassgait.models.robots.heading_frame import COORDINATES, from_heading_frame, to_heading_frame
from glassgait.models.task.command import Command
from glassgait.models.task.contact import sense_feet
from glassgait.models.task.gait import Gait
from glassgait.models.task.reward_machine import MachineState

NAMES = (*COORDINATES, *(f"previous action {joint}" for joint in quadruped.JOINTS))
"""What the closed loop remembers from one control step to the next, but for the machine's state.

Contacts follow from the pose, and what the estimator tells from all of these: neither remembers
more. Place and heading are left out, for nothing depends on them.
"""

UNITS: Array = np.concatenate(
    [
        [0.01, 0.05, 0.05],
        np.full(quadruped.N_JOINTS, 0.05),
        np.full(3, 0.5),
        np.full(3, 0.1),
        np.full(quadruped.N_JOINTS, 1.0),
        np.full(quadruped.N_JOINTS, 0.2),
    ]
)
"""What each coordinate is counted in (45; m, rad, rad/s, m/s, actions): part of a gait's sway."""
UNITS.flags.writeable = False

SPEEDS = slice(COORDINATES.index("forward speed"), COORDINATES.index("lateral speed") + 1)
"""Where the trunk's horizontal speeds stand."""

MOST_STEPS = 100
"""Control steps after which a robot that has not come back has no image."""

FIRST_STEPS = 150
"""Control steps from standing until a stride may begin."""

LONG_AGO = 1000
"""Control steps since the episode's start, as the machine is told: all that it excuses is over."""


@dataclass(frozen=True)
class Stride:
    """Where robots are one stride later.

    Attributes:
        images: Coordinates (n, 45), in `UNITS`; NaN for a robot that fell or did not come back.
        n_steps: Control steps that it took (n,); 0 for those.
    """

    images: Array
    n_steps: NDArray[np.int64]


class StrideMap:
    """Strides of one policy under several commands, in a world without noise.

    A robot is told by 45 coordinates in the instant in which it enters the machine's first state,
    counted in `UNITS`. The learned estimator stays in the loop.
    """

    def __init__(self, gait: Gait, policy: AlternatingController, command: Command) -> None:
        """
        Args:
            gait: The gait.
            policy: The controller.
            command: Velocities (m, 2) and dwells (m,) of m problems.
        """
        self.command = command
        self.policy = policy
        scenario = replace(Scenario(), sensor_noise=0.0, command=FixedCommand(0.0, 0.0, 8))
        self._task = TaskConfig.of_scenario(gait, scenario, policy)
        self._physics = make_physics(scenario.station)
        self._entered = gait.states.index(gait.initial)

    @property
    def is_stepwise(self) -> bool:
        """Whether the policy is constant but for jumps, and the map's derivatives tell nothing."""
        acting = self.policy.policy
        return isinstance(acting, BoostedTreesPolicy | AdditivePolicy)

    def first_points(self) -> Array:
        """Lets a robot of each command start from standing, until it enters after some seconds.

        Returns:
            Coordinates (m, 45); NaN where it fell or never entered.
        """
        n = len(self.command.dwell)
        simulator = self._simulator(n)
        standing = np.tile(kinematics.standing_state(robot.DEFAULT_STANCE), (n, 1))
        simulator.start_at(standing, self.command)
        return self._until_entered(simulator, FIRST_STEPS).images

    def stride(self, points: Array, problems: NDArray[np.int64]) -> Stride:
        """Takes a stride from each point.

        Args:
            points: Coordinates (n, 45), in `UNITS`.
            problems: Which command each robot has (n,).
        """
        sound = np.flatnonzero(np.isfinite(points).all(axis=1))
        images = np.full_like(points, np.nan)
        n_steps = np.zeros(len(points), dtype=np.int64)
        if len(sound):
            done = self._until_entered(self._started(points[sound], problems[sound]), 0)
            images[sound], n_steps[sound] = done.images, done.n_steps
        return Stride(images, n_steps)

    def __call__(self, points: Array, problems: NDArray[np.int64]) -> Array:
        """Maps points (n, 45) to those one stride later."""
        return self.stride(points, problems).images

    def _simulator(self, n_robots: int) -> BatchSimulator:
        return BatchSimulator(
            self._task,
            self._physics,
            n_robots=n_robots,
            generator=np.random.default_rng(0),
            estimator=estimator_in_loop(self.policy),
        )

    def _started(self, points: Array, problems: NDArray[np.int64]) -> BatchSimulator:
        """Returns robots that have just entered the machine's first state."""
        n = len(points)
        coordinates, action = np.split(points * UNITS, [len(COORDINATES)], axis=1)
        plant = from_heading_frame(coordinates)
        command = Command(*(values[problems] for values in self.command))
        simulator = self._simulator(n)
        simulator.start_at(plant, command)
        entered = MachineState(
            state=np.full(n, self._entered),
            iterations=np.zeros(n, dtype=np.int64),
            age=np.full(n, LONG_AGO),
        )
        feet = sense_feet(plant, np.zeros((n, quadruped.N_LEGS), dtype=bool))
        state = replace(
            simulator.state,
            machine=entered,
            touching=feet.touching,
            action=action,
            # A new command comes at whole multiples of its period, of which 0 is one.
            steps=np.ones(n, dtype=np.int64),
        )
        simulator.restore(state)
        # Has the estimator look at what was set.
        simulator.set_command(command)
        return simulator

    def _until_entered(self, simulator: BatchSimulator, not_before: int) -> Stride:
        n = simulator.n_robots
        images, n_steps = np.full((n, len(NAMES)), np.nan), np.zeros(n, dtype=np.int64)
        going = np.ones(n, dtype=bool)
        for step in range(1, not_before + MOST_STEPS + 1):
            action = self.policy.advance(step, simulator.observe(), None).action
            outcome = simulator.step(np.where(going[:, None], action, 0.0))
            going &= ~outcome.terminated
            state = simulator.state
            came = going & outcome.fired & (state.machine.state == self._entered)
            came &= step > not_before
            if came.any():
                coordinates = to_heading_frame(state.plant[came])
                images[came] = np.concatenate([coordinates, state.action[came]], axis=1) / UNITS
                n_steps[came] = step
                going &= ~came
            if not going.any():
                break
        return Stride(images, n_steps)
