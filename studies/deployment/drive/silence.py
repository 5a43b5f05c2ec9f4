"""Robots whose controller falls silent for good, each at another moment of its stride."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import DrawnCommands
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.link.watchdog import Phase, Watchdog, initial_watch, step_watch
from glassgait.models.policies.controller import Controller, estimator_in_loop
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.deployment.drive.losses import OVERTURNED

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


def walk_until_silent(
    gait: Gait, policy: Controller, scenario: Scenario, *, n_moments: int, seed: int
) -> Left:
    """Lets robots walk at three speeds, each until a moment of its own.

    The moments are equally far apart over two strides of the slowest rhythm. Dwell, turning, noise
    and initial states are drawn.

    Args:
        gait: The gait.
        policy: The controller.
        scenario: The world; its commands are left out.
        n_moments: Robots of each speed.
        seed: Seed of all that is drawn.

    Raises:
        InputError: if the plant is continuous, or a policy was made for another gait.
    """
    fastest = distilled_speeds(gait)[1]
    speed = np.repeat(fastest * np.array([1.0, 2.0, 3.0]) / 3.0, n_moments)
    stride = gait.dwell[1] * gait.n_states
    moment = SETTLED + np.tile(np.arange(n_moments) * 2 * stride // n_moments, 3)
    generator = np.random.default_rng(seed)
    drawn = sample_commands(gait, len(speed), generator)
    command = Command(np.stack([speed, drawn.velocity[:, 1]], axis=1), drawn.dwell)
    task = TaskConfig.of_scenario(gait, replace(scenario, command=DrawnCommands()), policy)
    simulator = BatchSimulator(
        task,
        make_physics(task.robot, scenario.station),
        n_robots=len(speed),
        generator=generator,
        estimator=estimator_in_loop(policy),
    )
    simulator.set_command(command)
    states, targets = (
        np.empty_like(simulator.state.plant),
        np.empty((len(speed), quadruped.N_JOINTS)),
    )
    fallen, walked = np.zeros(len(speed), dtype=bool), np.zeros(len(speed), dtype=bool)
    memory = policy.begin(len(speed))
    for step in range(moment.max() + 1):
        output = policy.advance(step, simulator.observe(), memory)
        memory = output.memory
        now = moment == step
        states[now] = simulator.state.plant[now]
        targets[now] = task.robot.joint_targets(output.action[now], limited=task.limit_targets)
        walked[now] = ~fallen[now]
        fallen |= simulator.step(np.where(fallen[:, None], 0.0, output.action)).terminated
        # Every 10 s another one would be drawn.
        simulator.set_command(command)
    return Left(speed, states, targets, walked)


def lower(
    robot: Robot, left: Left, station: StationConfig, watchdog: Watchdog, *, seconds: float
) -> Lowered:
    """Lets watchdogs lower robots that their controllers left.

    Args:
        robot: What robots they are.
        left: The robots.
        station: Their physics.
        watchdog: How long they wait for their controller.
        seconds: Time until the end (s).

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
    for step in range(round(seconds / CONTROL_PERIOD)):
        followed = []
        for part in range(PARTS):
            now = (step + part / PARTS) * CONTROL_PERIOD
            watches = [
                step_watch(robot, watch, None, now, watchdog, lean=lean)
                for watch, lean in zip(watches, leans[-1].tolist(), strict=True)
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
