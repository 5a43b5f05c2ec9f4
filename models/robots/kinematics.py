"""Closed-form kinematics of a quadruped, for any number of robots at once.

Every function takes the plant's state or positions with robots along the leading axes; see
`quadruped` for the layout.
"""

from typing import NamedTuple

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Box, Robot

LEVEL = 1e-9
"""Greatest rise of an edge, over its length, that counts as level."""


def cross(a: Array, b: Array) -> Array:
    """Returns cross products (..., 3): NumPy's is some times slower for small arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def rotation_matrix(quaternion: Array) -> Array:
    """Converts quaternions (..., 4; w, x, y, z) of any length to rotation matrices (..., 3, 3)."""
    w, x, y, z = _unit_components(quaternion)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        axis=-2,
    )


def gravity_direction(quaternion: Array) -> Array:
    """Returns the world's downward axis in the trunk's frame (..., 3).

    Args:
        quaternion: Attitudes (..., 4; w, x, y, z), of any length.
    """
    w, x, y, z = _unit_components(quaternion)
    return -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1)


def lean(quaternion: Array) -> Array:
    """Returns the angle between the trunk's vertical axis and the world's (...; °).

    Args:
        quaternion: Attitudes (..., 4; w, x, y, z), of any length.
    """
    upright = -gravity_direction(quaternion)[..., 2]
    return np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))


class LegPoints(NamedTuple):
    """Points of the four legs in the trunk's frame, each (..., 4, 3; m)."""

    thigh: Array
    knee: Array
    foot: Array


def leg_points(robot: Robot, joint_position: Array) -> LegPoints:
    """Locates thigh joint, knee and foot centre of each leg.

    Args:
        robot: What robots they are.
        joint_position: Joint positions (..., 12; rad).
    """
    q_hip, q_thigh, q_calf = _by_leg(joint_position)
    hip = np.cos(q_hip), np.sin(q_hip)
    knee = _along(robot.thigh_length, q_thigh)
    foot = _along(robot.calf_length, q_thigh + q_calf, knee)
    zero = np.zeros_like(q_hip)
    return LegPoints(
        thigh=_in_trunk(robot, *hip, zero, zero),
        knee=_in_trunk(robot, *hip, *knee),
        foot=_in_trunk(robot, *hip, *foot),
    )


def foot_positions(robot: Robot, joint_position: Array) -> Array:
    """Locates the foot centres in the trunk's frame (..., 4, 3; m), from (..., 12; rad)."""
    q_hip, q_thigh, q_calf = _by_leg(joint_position)
    knee = _along(robot.thigh_length, q_thigh)
    foot = _along(robot.calf_length, q_thigh + q_calf, knee)
    return _in_trunk(robot, np.cos(q_hip), np.sin(q_hip), *foot)


def _along(
    length: float, angle: Array, start: tuple[Array | float, Array | float] = (0.0, 0.0)
) -> tuple[Array, Array]:
    """Returns where a link ends in the leg's plane: x and z (..., 4; m)."""
    x, z = start
    return x - length * np.sin(angle), z - length * np.cos(angle)


def _in_trunk(robot: Robot, cos_hip: Array, sin_hip: Array, x: Array, z: Array) -> Array:
    """Returns points of the legs' planes (..., 4; m) in the trunk's frame (..., 4, 3; m)."""
    offset = robot.side * robot.thigh_offset
    swung = np.stack([x, cos_hip * offset - sin_hip * z, sin_hip * offset + cos_hip * z], -1)
    return robot.hip_origin + swung


def foot_velocities(robot: Robot, joint_position: Array, joint_velocity: Array) -> Array:
    """Returns how fast the joints move the foot centres in the trunk's frame (..., 4, 3; m/s).

    Args:
        robot: What robots they are.
        joint_position: Joint positions (..., 12; rad).
        joint_velocity: Joint velocities (..., 12; rad/s).
    """
    q_hip, q_thigh, q_calf = _by_leg(joint_position)
    v_hip, v_thigh, v_calf = _by_leg(joint_velocity)
    cos_hip, sin_hip = np.cos(q_hip), np.sin(q_hip)
    q_shank, v_shank = q_thigh + q_calf, v_thigh + v_calf
    thigh, calf = robot.thigh_length, robot.calf_length
    z = -thigh * np.cos(q_thigh) - calf * np.cos(q_shank)
    v_x = -thigh * np.cos(q_thigh) * v_thigh - calf * np.cos(q_shank) * v_shank
    v_z = thigh * np.sin(q_thigh) * v_thigh + calf * np.sin(q_shank) * v_shank
    offset = robot.side * robot.thigh_offset
    return np.stack(
        [
            v_x,
            -(sin_hip * offset + cos_hip * z) * v_hip - sin_hip * v_z,
            (cos_hip * offset - sin_hip * z) * v_hip + cos_hip * v_z,
        ],
        axis=-1,
    )


def foot_heights(robot: Robot, positions: Array) -> Array:
    """Measures how far each foot's lowest point is above the ground.

    Args:
        robot: What robots they are.
        positions: The plant's positions q (..., 19), or its state x (..., 37).

    Returns:
        Heights (..., 4; m), negative where a foot is pressed into the ground.
    """
    up = -gravity_direction(positions[..., quadruped.QUATERNION])
    feet = foot_positions(robot, positions[..., quadruped.JOINT_POSITION])
    base_height = positions[..., quadruped.POSITION][..., 2]
    return np.einsum("...lk,...k->...l", feet, up) + base_height[..., None] - robot.foot_radius


def world_points(positions: Array, points: Array) -> Array:
    """Returns points (..., k, 3; m) of the trunk's frame in the world's.

    Args:
        positions: The plant's positions q (..., 19), or its state x (..., 37).
        points: The points.
    """
    to_world = rotation_matrix(positions[..., quadruped.QUATERNION])
    turned = np.einsum("...ij,...kj->...ki", to_world, points)
    return turned + positions[..., None, quadruped.POSITION]


def world_feet(robot: Robot, positions: Array) -> Array:
    """Locates the foot centres in the world (..., 4, 3; m), from q (..., 19) or x (..., 37)."""
    feet = foot_positions(robot, positions[..., quadruped.JOINT_POSITION])
    return world_points(positions, feet)


def lowest_body_points(robot: Robot, positions: Array, shank_share: float = 1.0) -> Array:
    """Locates where the collision boxes that `body_clearance` measures are lowest.

    Of a limb that is the lower end of its middle line: beside a step that its foot stands at, a
    corner of its box would be taken for one inside of the step.

    Returns:
        Points (..., 9, 3; m) in the world; of the trunk the lowest corner.
    """
    up = -gravity_direction(positions[..., quadruped.QUATERNION])
    points = leg_points(robot, positions[..., quadruped.JOINT_POSITION])

    def lower(start: Array, end: Array) -> Array:
        falls = np.einsum("...lk,...k->...l", end - start, up) < 0.0
        return np.where(falls[..., None], end, start)

    # A level trunk has no lowest corner; its middle stands for it.
    corner = np.where(np.abs(up) < LEVEL, 0.0, np.sign(up))
    trunk = -0.5 * corner * np.array(robot.trunk_box)
    shank_end = points.knee + shank_share * (points.foot - points.knee)
    thigh, calf = lower(points.thigh, points.knee), lower(points.knee, shank_end)
    lowest = np.concatenate([trunk[..., None, :], thigh, calf], axis=-2)
    return world_points(positions, lowest)


def body_clearance(robot: Robot, positions: Array, shank_share: float = 1.0) -> Array:
    """Measures the lowest point above ground of each collision box that must never touch it.

    Args:
        robot: What robots they are.
        positions: The plant's positions q (..., 19), or its state x (..., 37).
        shank_share: Share of the calf's box, from the knee down, that is measured.

    Returns:
        Heights (..., 9; m) of the trunk, the four thighs and the four calves.
    """
    up = -gravity_direction(positions[..., quadruped.QUATERNION])
    base_height = positions[..., quadruped.POSITION][..., 2]
    joint_position = positions[..., quadruped.JOINT_POSITION]
    q_hip, q_thigh, q_calf = _by_leg(joint_position)
    points = leg_points(robot, joint_position)

    up_x, up_y, up_z = (up[..., None, axis] for axis in range(3))
    lateral = np.cos(q_hip) * up_y + np.sin(q_hip) * up_z
    vertical = -np.sin(q_hip) * up_y + np.cos(q_hip) * up_z

    def limb(start: Array, end: Array, angle: Array, box: Box) -> Array:
        along = np.sin(angle) * up_x + np.cos(angle) * vertical
        across = np.cos(angle) * up_x - np.sin(angle) * vertical
        reach = np.abs(along) * box[0] + np.abs(lateral) * box[1] + np.abs(across) * box[2]
        centre = np.einsum("...lk,...k->...l", 0.5 * (start + end), up)
        return centre + base_height[..., None] - 0.5 * reach

    trunk = base_height - 0.5 * np.abs(up) @ np.array(robot.trunk_box)
    thigh = limb(points.thigh, points.knee, q_thigh, robot.thigh_box)
    shank_end = points.knee + shank_share * (points.foot - points.knee)
    length, width, depth = robot.calf_box
    shank_box = (shank_share * length, width, depth)
    calf = limb(points.knee, shank_end, q_thigh + q_calf, shank_box)
    return np.concatenate([trunk[..., None], thigh, calf], axis=-1)


def base_velocity(state: Array) -> tuple[Array, Array]:
    """Expresses the trunk's velocity in its own frame.

    Args:
        state: The plant's state x (..., 37).

    Returns:
        Linear (..., 3; m/s) and angular velocity (..., 3; rad/s) of the trunk in its own frame.
    """
    to_trunk = np.swapaxes(rotation_matrix(state[..., quadruped.QUATERNION]), -1, -2)
    linear = np.einsum("...ij,...j->...i", to_trunk, state[..., quadruped.LINEAR_VELOCITY])
    angular = np.einsum("...ij,...j->...i", to_trunk, state[..., quadruped.ANGULAR_VELOCITY])
    return linear, angular


def standing_state(robot: Robot, joint_position: Array | None = None) -> Array:
    """Places level robots, facing along x, at rest with their lowest foot just on the ground.

    Args:
        robot: What robots they are.
        joint_position: Joint positions (..., 12; rad); the default stance by default.

    Returns:
        The plant's state x (..., 37), at the world's origin.
    """
    if joint_position is None:
        joint_position = robot.default_stance
    state = np.zeros((*joint_position.shape[:-1], quadruped.N_POSITIONS + quadruped.N_VELOCITIES))
    state[..., 0] = 1.0
    state[..., quadruped.JOINT_POSITION] = joint_position
    state[..., 6] = -foot_heights(robot, state).min(axis=-1)
    return state


def _by_leg(joint_values: Array) -> tuple[Array, Array, Array]:
    legs = joint_values.reshape(*joint_values.shape[:-1], quadruped.N_LEGS, 3)
    return legs[..., 0], legs[..., 1], legs[..., 2]


def _unit_components(quaternion: Array) -> Array:
    # A discrete plant adds rates to its quaternion and never shortens it: within a minute of
    # walking it is a tenth too long.
    norm = np.sqrt(np.sum(np.square(quaternion), axis=-1, keepdims=True))
    # All zeros stand for a state that is not finite; no attitude.
    return np.moveaxis(quaternion / np.where(norm > 0.0, norm, 1.0), -1, 0)
