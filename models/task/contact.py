"""Foot contacts, sensed from the robot's pose above flat ground."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.a1 import kinematics
from glassgait.models.a1.robot import Array


class FootSense(NamedTuple):
    """What the feet sense at one instant.

    Attributes:
        touching: Whether each foot presses on the ground at this instant (..., 4).
        contact: Whether it does now or did at the previous step (..., 4).
        height: Height of each foot's lowest point above the ground (..., 4; m).
    """

    touching: NDArray[np.bool_]
    contact: NDArray[np.bool_]
    height: Array


def sense_feet(positions: Array, previously_touching: NDArray[np.bool_]) -> FootSense:
    """Senses contacts and heights.

    Point contact on a half space presses exactly where a foot's sphere reaches below the plane, so
    the contact follows from the pose alone. The memory of one step bridges a bouncing touch-down.

    Args:
        positions: The plant's positions q (..., 19), or its state x (..., 37).
        previously_touching: `touching` of the previous control step (..., 4).
    """
    height = kinematics.foot_heights(positions)
    touching = height < 0.0
    return FootSense(touching=touching, contact=touching | previously_touching, height=height)
