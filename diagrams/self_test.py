"""What a simulated robot measures in the self-test of its wiring."""

import numpy as np

from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.link.self_test import (
    PAIRS,
    Prediction,
    Trace,
    exchange,
    self_test_targets,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.imu import measure_imu

SETTLING_STEPS = 100
"""Control steps in which a robot that is put on its feet comes to rest."""


def predict_self_test(robot: Robot, station: StationConfig) -> Prediction:
    """Simulates the self-test without noise, wired rightly and with each pair of joints exchanged.

    Args:
        robot: The robot, in its stance on level ground.
        station: Physics.
    """
    targets = self_test_targets(robot)
    orders = [np.arange(quadruped.N_JOINTS), *map(exchange, PAIRS)]
    expected, *exchanged = measure_self_test(
        robot, station, np.stack([targets[:, order] for order in orders])
    )
    return Prediction(expected, exchanged)


def measure_self_test(robot: Robot, station: StationConfig, targets: Array) -> list[Trace]:
    """Returns what robots measure that come to rest in their stance and then follow targets.

    Args:
        robot: What robots they are.
        station: Physics.
        targets: Joint targets of each (m, n, 12; rad).
    """
    physics = make_physics(robot, station)
    physics.set_friction(np.array([station.friction]))
    stance = np.tile(robot.default_stance, (len(targets), 1))
    standing = kinematics.standing_state(robot, stance)
    states = standing
    for _ in range(SETTLING_STEPS):
        states = physics.step(states, stance).states
    moved, touching, imu = [], [], []
    for now in targets.swapaxes(0, 1):
        before = states[:, quadruped.LINEAR_VELOCITY]
        states, feet = physics.step(states, now)
        moved.append(states)
        touching.append(feet)
        imu.append(measure_imu(states, before, station.terrain.gravity))
    return [
        Trace(own[:, quadruped.JOINT_POSITION], own[:, quadruped.JOINT_VELOCITY], feet, readings)
        for own, feet, readings in zip(
            *(np.stack(parts, axis=1) for parts in (moved, touching, imu)), strict=True
        )
    ]
