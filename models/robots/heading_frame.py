"""What a gait repeats: the plant's state seen from where the robot is and where it faces.

Flat ground is alike everywhere and in every direction, and no policy sees where it is or where it
faces. A periodic gait therefore comes back to its state but for the place (x, y) and the heading,
which are left out here.
"""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped

COORDINATES = (
    "height",
    "roll",
    "pitch",
    *quadruped.JOINTS,
    "roll rate",
    "pitch rate",
    "yaw rate",
    "forward speed",
    "lateral speed",
    "vertical speed",
    *(f"{joint} rate" for joint in quadruped.JOINTS),
)
"""Names of the coordinates: m, rad, rad/s and m/s; rates and speeds about and along the axes of the
frame that stands upright and faces as the trunk does."""

N_COORDINATES = len(COORDINATES)

_JOINTS = slice(3, 3 + quadruped.N_JOINTS)
_ANGULAR = slice(15, 18)
_LINEAR = slice(18, 21)
_JOINT_RATES = slice(21, N_COORDINATES)


def to_heading_frame(state: Array) -> Array:
    """Leaves place and heading out.

    Args:
        state: Plant states x (..., 37), with quaternions of any length.

    Returns:
        Coordinates (..., 33), as `COORDINATES` names them.
    """
    rotation = kinematics.rotation_matrix(state[..., quadruped.QUATERNION])
    roll = np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2])
    pitch = -np.arcsin(np.clip(rotation[..., 2, 0], -1.0, 1.0))
    heading = np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0])
    height = state[..., quadruped.POSITION][..., 2]
    return np.concatenate(
        [
            np.stack([height, roll, pitch], axis=-1),
            state[..., quadruped.JOINT_POSITION],
            _turned(state[..., quadruped.ANGULAR_VELOCITY], -heading),
            _turned(state[..., quadruped.LINEAR_VELOCITY], -heading),
            state[..., quadruped.JOINT_VELOCITY],
        ],
        axis=-1,
    )


def from_heading_frame(coordinates: Array) -> Array:
    """Puts robots at the world's origin, facing along x.

    Args:
        coordinates: Coordinates (..., 33), as `COORDINATES` names them.

    Returns:
        Plant states x (..., 37).
    """
    half = 0.5 * coordinates[..., 1:3]
    (cos_roll, cos_pitch), (sin_roll, sin_pitch) = (
        np.moveaxis(function(half), -1, 0) for function in (np.cos, np.sin)
    )
    state = np.zeros((*coordinates.shape[:-1], quadruped.N_POSITIONS + quadruped.N_VELOCITIES))
    state[..., quadruped.QUATERNION] = np.stack(
        [cos_roll * cos_pitch, sin_roll * cos_pitch, cos_roll * sin_pitch, -sin_roll * sin_pitch],
        axis=-1,
    )
    state[..., quadruped.POSITION.stop - 1] = coordinates[..., 0]
    state[..., quadruped.JOINT_POSITION] = coordinates[..., _JOINTS]
    state[..., quadruped.ANGULAR_VELOCITY] = coordinates[..., _ANGULAR]
    state[..., quadruped.LINEAR_VELOCITY] = coordinates[..., _LINEAR]
    state[..., quadruped.JOINT_VELOCITY] = coordinates[..., _JOINT_RATES]
    return state


def _turned(vector: Array, angle: Array) -> Array:
    """Turns vectors (..., 3) about the vertical by angles (...; rad)."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y, z = np.moveaxis(vector, -1, 0)
    return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
