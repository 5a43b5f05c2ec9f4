"""Foot contacts, sensed from the robot's pose above flat ground."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics
from glassgait.models.robots.robot import Robot


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


def touches_ground(height: Array) -> NDArray[np.bool_]:
    """Decides by the heights (..., 4; m) of the feet which of them press on the ground.

    Point contact on a half space presses exactly where a foot's sphere reaches below the plane, so
    in Drake the contact follows from the pose alone.
    """
    return height < 0.0


def sense_feet(
    robot: Robot,
    positions: Array,
    previously_touching: NDArray[np.bool_],
    touching: NDArray[np.bool_] | None = None,
) -> FootSense:
    """Senses contacts and heights. The memory of one step bridges a bouncing touch-down.

    Args:
        robot: What robots they are.
        positions: The plant's positions q (..., 19), or its state x (..., 37).
        previously_touching: `touching` of the previous control step (..., 4).
        touching: Whether each foot presses on the ground (..., 4); by default as its pose has it.
    """
    height = kinematics.foot_heights(robot, positions)
    if touching is None:
        touching = touches_ground(height)
    return FootSense(touching=touching, contact=touching | previously_touching, height=height)


def flip_contacts(
    contact: NDArray[np.bool_], uniform: Array, flip_share: float
) -> NDArray[np.bool_]:
    """Reads contacts by sensors that are wrong now and then.

    Args:
        contact: Whether each foot touches (..., 4).
        uniform: Numbers drawn from 0 to 1 (..., 4).
        flip_share: Share of the readings that are wrong.
    """
    return contact ^ (uniform < flip_share)
