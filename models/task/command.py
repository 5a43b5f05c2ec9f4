"""Commands: forward speed, yaw rate and the rhythm, and how they are drawn."""

from typing import NamedTuple

import numpy as np

from models.a1.robot import Array
from models.task.gait import Gait

DEAD_BAND = 0.2
"""Commanded speeds below this (m/s) become 0."""


class Command(NamedTuple):
    """What a robot is asked to do.

    Attributes:
        velocity: Forward speed and yaw rate (..., 2; m/s, rad/s).
        dwell: Iterations to stay in a state of the reward machine (...; control steps).
    """

    velocity: Array
    dwell: Array


def sample_commands(gait: Gait, count: int, generator: np.random.Generator) -> Command:
    """Draws commands over the gait's whole range.

    Args:
        gait: The gait, for its ranges.
        count: Number of commands.
        generator: Source of randomness.

    Returns:
        Velocities (count, 2) and dwells (count,).
    """
    velocity = generator.uniform(-1.0, 1.0, size=(count, 2))
    velocity *= [gait.max_speed, gait.max_yaw_rate]
    velocity[np.abs(velocity[:, 0]) < DEAD_BAND, 0] = 0.0
    low, high = gait.dwell
    return Command(velocity, generator.integers(low, high + 1, size=count).astype(float))
