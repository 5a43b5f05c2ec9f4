"""Constants of the Unitree A1 and the joint-level law that drives it."""

from pathlib import Path

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.robots.quadruped import LEG_JOINTS, LEGS

URDF_PATH = Path(__file__).parent / "a1" / "a1.urdf"

MASS = 12.776
"""Mass of the robot (kg)."""

# Lengths (m).
HIP_OFFSET_X = 0.1805
HIP_OFFSET_Y = 0.047
THIGH_OFFSET_Y = 0.0838
THIGH_LENGTH = 0.2
CALF_LENGTH = 0.2
FOOT_RADIUS = 0.02
TRUNK_BOX = (0.267, 0.194, 0.114)
THIGH_BOX = (0.2, 0.0245, 0.034)
CALF_BOX = (0.2, 0.016, 0.016)

# Joint limits by kind of joint: position (rad), effort (N·m), velocity (rad/s).
POSITION_LIMITS = {"hip": (-0.8029, 0.8029), "thigh": (-1.0472, 4.1888), "calf": (-2.6965, -0.9163)}
EFFORT_LIMIT = 33.5
VELOCITY_LIMIT = 21.0

LOWER_LIMITS: Array = np.array([POSITION_LIMITS[joint][0] for _ in LEGS for joint in LEG_JOINTS])
UPPER_LIMITS: Array = np.array([POSITION_LIMITS[joint][1] for _ in LEGS for joint in LEG_JOINTS])

# Gains of the joints' PD control (N·m/rad, N·m·s/rad).
STIFFNESS = 20.0
DAMPING = 0.5

DEFAULT_STANCE: Array = np.array(
    [0.1, 0.8, -1.5, -0.1, 0.8, -1.5, 0.1, 1.0, -1.5, -0.1, 1.0, -1.5],
)
ACTION_SCALE = 0.25

for _constant in (LOWER_LIMITS, UPPER_LIMITS, DEFAULT_STANCE):
    _constant.flags.writeable = False


def joint_targets(action: Array, *, limited: bool = False) -> Array:
    """Returns the joint position targets (..., 12; rad) that an action (..., 12) asks for.

    Args:
        action: Actions (..., 12).
        limited: Whether to return what joints follow that are kept within their ranges: the
            nearest targets there. NaN stays NaN.
    """
    targets = DEFAULT_STANCE + ACTION_SCALE * action
    return np.clip(targets, LOWER_LIMITS, UPPER_LIMITS) if limited else targets


def joint_torque(*, target: Array, position: Array, velocity: Array) -> Array:
    """Evaluates the joints' PD law, limited to the motors' effort.

    The plant integrates the same law implicitly; this is its value at one instant.

    Args:
        target: Joint position targets (..., 12; rad).
        position: Joint positions (..., 12; rad).
        velocity: Joint velocities (..., 12; rad/s).

    Returns:
        Torques (..., 12; N·m).
    """
    torque = STIFFNESS * (target - position) - DAMPING * velocity
    return np.clip(torque, -EFFORT_LIMIT, EFFORT_LIMIT)
