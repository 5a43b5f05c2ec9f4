"""Robots whose controller falls silent for good, each at another moment of its stride."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.link.watchdog import Phase, Watchdog, initial_watch, step_watch
from glassgait.models.policies.controller import Controller
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.studies.common.episode import ControlStep, Observer, episode, give
from glassgait.studies.deployment.drive.packet_loss import OVERTURNED

FASTEST = 0.75
"""Greatest forward speed of robots whose controller falls silent (m/s), at most the gait's."""

SETTLED = 120
"""Control steps after which robots have found their gait."""

PARTS = 2
"""Times in a control period at which a watchdog looks."""


class Left(NamedTuple):
    """Robots at the moment in which their controller answered last.

    Attributes:
        speed: Commanded forward speeds (n,; m/s).
        states: Plant states x (n, 37).
        targets: Joint targets of the last answers (n, 12; rad).
        walked: Whether a robot had not fallen before (n,).
    """

    speed: Array
    states: Array
    targets: Array
    walked: NDArray[np.bool_]


class Lowered(NamedTuple):
    """What became of robots without a controller.

    Attributes:
        greatest: Greatest lean of the trunk (n,; °).
        final: Its lean in the end (n,; °).
        descent: Greatest speed at which it went down (n,; m/s).
    """

    greatest: Array
    final: Array
    descent: Array


def silence_controllers(
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    *,
    n_moments: int,
    push: float,
    n_steps: int,
    watchdog: Watchdog,
    seed: int,
) -> pd.DataFrame:
    """Lets robots walk, silences their controllers, and counts what becomes of them.

    Args:
        gait: The gait.
        controller: The controller.
        scenario: The world; its commands are left out.
        n_moments: Robots of each speed.
        push: What is added to each trunk's velocity (m/s).
        n_steps: Control steps from then to the end.
        watchdog: How long robots wait for their controller.
        seed: Seed of all that is drawn.
    """
    left = walk_until_silent(gait, controller, scenario, n_moments=n_moments, seed=seed)
    left = pushed(left, push, seed)
    lowered = lower(
        controller.robot, left, scenario.station_of(controller), watchdog, n_steps=n_steps
    )
    return silence_table(left, lowered)


def walk_until_silent(
    gait: Gait, controller: Controller, scenario: Scenario, *, n_moments: int, seed: int
) -> Left:
    """Lets robots walk at three speeds, each until a moment of its own.

    The moments are equally far apart over two strides of the slowest rhythm. Dwell, turning, noise
    and initial states are drawn.

    Raises:
        InputError: if the plant is continuous, or a policy was made for another gait.
    """
    fastest = min(FASTEST, gait.max_speed)
    speed = np.repeat(fastest * np.array([1.0, 2.0, 3.0]) / 3.0, n_moments)
    stride = gait.dwell[1] * gait.n_states
    moment = SETTLED + np.tile(np.arange(n_moments) * 2 * stride // n_moments, 3)
    generator = np.random.default_rng(seed)
    drawn = sample_commands(gait, len(speed), generator)
    command = Command(np.stack([speed, drawn.velocity[:, 1]], axis=1), drawn.dwell)
    world = replace(scenario, command=DrawnCommands())
    last = _LastAnswers(
        controller.robot, speed, moment, limited=world.joint_law(controller).limited
    )
    episode(
        gait,
        controller,
        world,
        n_robots=len(speed),
        n_steps=int(moment.max()) + 1,
        seed=generator,
        observers=[last],
        events=[give(0, command)],
    )
    return last.left


class _LastAnswers(Observer):
    """Records each robot at a moment of its own."""

    def __init__(
        self, robot: Robot, speed: Array, moment: NDArray[np.int64], *, limited: bool
    ) -> None:
        n = len(speed)
        states = np.empty((n, quadruped.N_POSITIONS + quadruped.N_VELOCITIES))
        targets, walked = np.empty((n, quadruped.N_JOINTS)), np.zeros(n, dtype=bool)
        self.left = Left(speed, states, targets, walked)
        self._robot, self._moment, self._limited = robot, moment, limited
        self._fallen = np.zeros(n, dtype=bool)

    def observe(self, step: ControlStep) -> None:
        now = self._moment == step.step
        self.left.states[now] = step.before.plant[now]
        action = step.after.action[now]
        self.left.targets[now] = self._robot.joint_targets(action, limited=self._limited)
        self.left.walked[now] = ~self._fallen[now]
        self._fallen = step.fallen


def lower(
    robot: Robot, left: Left, station: StationConfig, watchdog: Watchdog, *, n_steps: int
) -> Lowered:
    """Advances robots that their watchdogs alone move.

    Raises:
        InputError: if the plant is continuous.
    """
    physics, states = make_physics(robot, station), left.states
    physics.set_friction(np.array([station.friction]))
    watches = [
        initial_watch(robot)._replace(phase=Phase.FOLLOWING, answered=0.0, newest=own, targets=own)
        for own in left.targets
    ]
    leans, descents = [kinematics.lean(states[:, quadruped.QUATERNION])], []
    for step in range(n_steps):
        followed = []
        for part in range(PARTS):
            now = (step + part / PARTS) * CONTROL_PERIOD
            watches = [
                step_watch(robot, watch, None, now, watchdog, position=at, lean=lean)
                for watch, lean, at in zip(
                    watches, leans[-1].tolist(), states[:, quadruped.JOINT_POSITION], strict=True
                )
            ]
            followed.append(np.array([watch.targets for watch in watches]))
        states = physics.step(
            states,
            followed[1],
            previous_targets=followed[0],
            latency=np.full(len(states), CONTROL_PERIOD / PARTS),
        ).states
        leans.append(kinematics.lean(states[:, quadruped.QUATERNION]))
        descents.append(-states[:, quadruped.LINEAR_VELOCITY][:, 2])
    return Lowered(np.max(leans, axis=0), leans[-1], np.max(descents, axis=0))


def pushed(left: Left, speed: float, seed: int) -> Left:
    """Returns robots with a speed (m/s) added to each trunk's, in a direction drawn by a seed."""
    angle = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(left.states))
    states = left.states.copy()
    velocity = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    states[:, quadruped.LINEAR_VELOCITY] += speed * velocity
    return left._replace(states=states)


def silence_table(left: Left, lowered: Lowered) -> pd.DataFrame:
    """Counts robots by their speed; those that had fallen before are left out."""
    rows = []
    for speed in np.unique(left.speed):
        own = (left.speed == speed) & left.walked
        rows.append(
            {
                "speed (m/s)": round(float(speed), 3),
                "robots": int(own.sum()),
                "overturned": int(np.sum(~(lowered.greatest[own] <= OVERTURNED))),
                "greatest lean (°)": float(np.max(lowered.greatest[own], initial=0.0)),
                "lean in the end (°)": float(np.max(lowered.final[own], initial=0.0)),
                "fastest descent (m/s)": float(np.max(lowered.descent[own], initial=0.0)),
            }
        )
    return pd.DataFrame(rows)
