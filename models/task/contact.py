"""Foot contacts, sensed from the robot's pose above the ground."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import LEVEL_GROUND, Ground


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


def sense_feet(
    robot: Robot,
    positions: Array,
    previously_touching: NDArray[np.bool_],
    touching: NDArray[np.bool_] | None = None,
    ground: Ground = LEVEL_GROUND,
) -> FootSense:
    """Senses contacts and heights. The memory of one step bridges a bouncing touch-down.

    Args:
        robot: What robots they are.
        positions: The plant's positions q (..., 19), or its state x (..., 37).
        previously_touching: `touching` of the previous control step (..., 4).
        touching: Whether each foot presses on the ground (..., 4); by default as its pose has it.
        ground: What they stand on.
    """
    height = ground.foot_heights(robot, positions)
    if touching is None:
        # On level ground height and contact are one measurement.
        touching = height < 0.0 if ground.is_level else ground.touching(robot, positions)
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
