"""What a robot on Unitree's wire senses, printed; it is sent nothing."""

import time
from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.models.link.dds import Endpoint
from glassgait.models.link.low_state import gravity_of, joints_of, touching_of
from glassgait.models.link.message_filter import StateFilter
from glassgait.models.link.motors import foot_numbers, motor_numbers
from glassgait.models.link.remote import read_remote
from glassgait.models.link.unitree_messages import Record
from glassgait.models.robots.quadruped import JOINTS, LEGS
from glassgait.models.robots.robot import Robot
from glassgait.studies.common.console import say
from glassgait.studies.common.tables import print_table

EVERY = 1.0
"""Time between two tables (s)."""


def look(robot: Robot, endpoint: Endpoint, stopped: Callable[[], bool]) -> StateFilter:
    """Prints once a second what the robot senses, and how many states came, until asked to end.

    Returns:
        What was counted of its states.
    """
    states = StateFilter()
    touching, due, heard_before = np.zeros(len(LEGS), dtype=bool), time.monotonic() + EVERY, 0
    latest: Record | None = None
    while not stopped():
        for heard in endpoint.take(0.1):
            state = states.believed(heard)
            if state is not None:
                latest, touching = state, touching_of(robot, state, touching)
        if time.monotonic() < due:
            continue
        due = time.monotonic() + EVERY
        n_heard = states.counts.heard - heard_before
        heard_before = states.counts.heard
        if latest is None or not n_heard:
            say("the robot is silent")
            continue
        print_table("joints", joints_table(robot, latest))
        print_table("feet", feet_table(robot, latest, touching))
        say(f"{_sensed(latest)}; {n_heard} states in the last second")
    return states


def joints_table(robot: Robot, state: Record) -> pd.DataFrame:
    """Returns a row for each joint: its motor's number, angle, velocity and range."""
    position, velocity = np.split(joints_of(robot, state), 2)
    return pd.DataFrame(
        {
            "joint": JOINTS,
            "motor": motor_numbers(robot),
            "angle (rad)": position,
            "least (rad)": robot.lower_limits,
            "greatest (rad)": robot.upper_limits,
            "velocity (rad/s)": velocity,
        }
    )


def feet_table(robot: Robot, state: Record, touching: NDArray[np.bool_]) -> pd.DataFrame:
    """Returns a row for each foot: what its sensor counts, and whether it touches by that."""
    counts = state["foot_force"][foot_numbers(robot)]
    return pd.DataFrame({"foot": LEGS, "counts": counts, "touches": touching})


def _sensed(state: Record) -> str:
    imu, remote = state["imu_state"], read_remote(state["wireless_remote"].tobytes())
    parts = {
        "gravity": gravity_of(state),
        "turning (rad/s)": imu["gyroscope"],
        "force (m/s²)": imu["accelerometer"],
        "sticks": np.array([remote.lx, remote.ly, remote.rx, remote.ry]),
    }
    numbers = "; ".join(
        f"{name} {' '.join(f'{value:+.2f}' for value in values)}" for name, values in parts.items()
    )
    return f"{numbers}; pressed: {remote.buttons.name or 'nothing'}"
