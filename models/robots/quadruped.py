"""The layout of all robots: four legs of three joints, in one order.

Legs are ordered FL, FR, RL, RR (front left, front right, rear left, rear right) and the joints of
a leg hip, thigh, calf, in every array of this project.
"""

import numpy as np

from glassgait.models.errors import unknown_name

LEGS = ("FL", "FR", "RL", "RR")
LEG_JOINTS = ("hip", "thigh", "calf")
JOINTS = tuple(f"{leg}_{joint}" for leg in LEGS for joint in LEG_JOINTS)

AXES = {"hip": (1.0, 0.0, 0.0), "thigh": (0.0, 1.0, 0.0), "calf": (0.0, 1.0, 0.0)}
"""Axis of each kind of joint."""

N_LEGS = len(LEGS)
N_JOINTS = len(JOINTS)
N_POSITIONS = 7 + N_JOINTS
N_VELOCITIES = 6 + N_JOINTS

# Slices of the plant's state x = [q, v]; q starts with the trunk's quaternion (w, x, y, z) and
# position in the world, v with its angular and linear velocity, both expressed in the world.
QUATERNION = slice(0, 4)
POSITION = slice(4, 7)
JOINT_POSITION = slice(7, N_POSITIONS)
ANGULAR_VELOCITY = slice(N_POSITIONS, N_POSITIONS + 3)
LINEAR_VELOCITY = slice(N_POSITIONS + 3, N_POSITIONS + 6)
JOINT_VELOCITY = slice(N_POSITIONS + 6, N_POSITIONS + N_VELOCITIES)


def joint_index(joint: str | int) -> int:
    """Returns the index of a joint such as FL_hip; returns an index as it is."""
    if isinstance(joint, str) and joint in JOINTS:
        return JOINTS.index(joint)
    # True and False are integers in Python.
    is_number = not isinstance(joint, str | bool) and isinstance(joint, int | np.integer)
    if is_number and int(joint) in range(N_JOINTS):
        return int(joint)
    raise unknown_name("joint", joint, JOINTS, f", or 0 to {N_JOINTS - 1}")
