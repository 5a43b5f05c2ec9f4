"""Closed-form kinematics of a quadruped, for any number of robots at once.

Every function takes the plant's state or positions with robots along the leading axes; see
`quadruped` for the layout.
"""

from typing import NamedTuple

import numpy as np

from glassgait.models.arrays import Array, cross, stacked
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Box, Robot

LEVEL = 1e-9  # greatest slope of an edge that counts as level


def rotation_matrix(quaternion: Array) -> Array:
    """Converts quaternions (..., 4; w, x, y, z) of any length to rotation matrices (..., 3, 3)."""
    w, x, y, z = _unit_components(quaternion)
    xx, yy, zz = x * x, y * y, z * z
    xy, xz, yz = x * y, x * z, y * z
    wx, wy, wz = w * x, w * y, w * z
    rows = stacked(
        *(1 - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)),
        *(2 * (xy + wz), 1 - 2 * (xx + zz), 2 * (yz - wx)),
        *(2 * (xz - wy), 2 * (yz + wx), 1 - 2 * (xx + yy)),
    )
    return rows.reshape(*rows.shape[:-1], 3, 3)


def gravity_direction(quaternion: Array) -> Array:
    """Returns the world's downward axis in the trunk's frame (..., 3), from quaternions."""
    w, x, y, z = _unit_components(quaternion)
    return -stacked(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))


def lean(quaternion: Array) -> Array:
    """Returns the angle between the trunk's vertical axis and the world's (...; °)."""
    upright = -gravity_direction(quaternion)[..., 2]
    return np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))


def foot_positions(robot: Robot, joint_position: Array) -> Array:
    """Locates the foot centres in the trunk's frame (..., 4, 3; m), from (..., 12; rad)."""
    legs = leg_angles(joint_position)
    return robot.hip_origin + _swung(robot, legs, *_foot(robot, legs, _knee(robot, legs)))


class FootMotion(NamedTuple):
    """Motion of the feet in the trunk's frame, each (..., 4, 3)."""

    position: Array  # of their centres (m)
    velocity: Array  # of their centres (m/s)
    turning: Array  # angular velocities of the shanks, which the feet are fixed to (rad/s)


def foot_motion(robot: Robot, joint_position: Array, joint_velocity: Array) -> FootMotion:
    """Returns the motion of the feet, from joint positions and velocities (..., 12; rad, rad/s)."""
    # Velocities in each leg's plane.
    legs = leg_angles(joint_position)
    x, z = _foot(robot, legs, _knee(robot, legs))
    rates = joint_velocity.reshape(*joint_velocity.shape[:-1], quadruped.N_LEGS, 3)
    v_hip, v_thigh = rates[..., 0], rates[..., 1]
    v_shank = v_thigh + rates[..., 2]
    thigh, calf = robot.thigh_length, robot.calf_length
    v_x = -thigh * legs.cos_thigh * v_thigh - calf * legs.cos_shank * v_shank
    v_z = thigh * legs.sin_thigh * v_thigh + calf * legs.sin_shank * v_shank
    # The plane swings about the hip's axis.
    swung = _swung(robot, legs, x, z)
    velocity = stacked(
        v_x, -swung[..., 2] * v_hip - legs.sin_hip * v_z, swung[..., 1] * v_hip + legs.cos_hip * v_z
    )
    turning = stacked(v_hip, legs.cos_hip * v_shank, legs.sin_hip * v_shank)
    return FootMotion(robot.hip_origin + swung, velocity, turning)


def rolling_velocity(robot: Robot, turning: Array, down: Array) -> Array:
    """Returns velocities of the feet's lowest points relative to their centres (..., 4, 3; m/s).

    `turning` holds the feet's angular velocities (..., 4, 3; rad/s), `down` is the world's downward
    axis (..., 1, 3); both are in the trunk's frame.
    """
    return cross(turning, robot.foot_radius * down)


class LegAngles(NamedTuple):
    """Sines and cosines of each leg's angles (..., 4); the shank's is thigh plus calf."""

    sin_hip: Array
    sin_thigh: Array
    sin_shank: Array
    cos_hip: Array
    cos_thigh: Array
    cos_shank: Array


def leg_angles(joint_position: Array) -> LegAngles:
    """Returns sines and cosines of the legs' angles, from joint positions (..., 12; rad)."""
    angles = joint_position.reshape(*joint_position.shape[:-1], quadruped.N_LEGS, 3).copy()
    angles[..., 2] += angles[..., 1]
    sine, cosine = np.sin(angles), np.cos(angles)
    return LegAngles(
        *(sine[..., 0], sine[..., 1], sine[..., 2]),
        *(cosine[..., 0], cosine[..., 1], cosine[..., 2]),
    )


def _knee(robot: Robot, legs: LegAngles) -> tuple[Array, Array]:
    """Returns the knee's x and z in the leg's plane (..., 4; m)."""
    return 0.0 - robot.thigh_length * legs.sin_thigh, 0.0 - robot.thigh_length * legs.cos_thigh


def _foot(robot: Robot, legs: LegAngles, knee: tuple[Array, Array]) -> tuple[Array, Array]:
    """Returns the x and z of the foot's centre in the leg's plane (..., 4; m)."""
    x, z = knee
    return x - robot.calf_length * legs.sin_shank, z - robot.calf_length * legs.cos_shank


def _swung(robot: Robot, legs: LegAngles, x: Array, z: Array) -> Array:
    """Converts points in the legs' planes (..., 4; m) to vectors from the hips (..., 4, 3; m)."""
    offset = robot.thigh_offsets
    return stacked(
        x, legs.cos_hip * offset - legs.sin_hip * z, legs.sin_hip * offset + legs.cos_hip * z
    )


def leg_points(robot: Robot, legs: LegAngles) -> tuple[Array, Array, Array]:
    """Returns thigh joints, knees and foot centres in the trunk's frame (..., 4, 3; m)."""
    zero, knee = np.zeros_like(legs.sin_hip), _knee(robot, legs)
    points = ((zero, zero), knee, _foot(robot, legs, knee))
    thigh, knees, feet = (robot.hip_origin + _swung(robot, legs, *point) for point in points)
    return thigh, knees, feet


def foot_heights(robot: Robot, positions: Array) -> Array:
    """Returns heights of the feet's lowest points (..., 4; m), from q (..., 19) or x (..., 37)."""
    up = -gravity_direction(positions[..., quadruped.QUATERNION])
    feet = foot_positions(robot, positions[..., quadruped.JOINT_POSITION])
    base_height = positions[..., quadruped.POSITION][..., 2]
    return _heights_of_feet(robot, feet, up, base_height)


def _heights_of_feet(robot: Robot, feet: Array, up: Array, base_height: Array) -> Array:
    return np.einsum("...lk,...k->...l", feet, up) + base_height[..., None] - robot.foot_radius


def _in_world(positions: Array, points: Array) -> Array:
    """Converts points (..., k, 3; m) from the trunk's frame to the world's."""
    to_world = rotation_matrix(positions[..., quadruped.QUATERNION])
    turned = np.einsum("...ij,...kj->...ki", to_world, points)
    return turned + positions[..., None, quadruped.POSITION]


def world_feet(robot: Robot, positions: Array) -> Array:
    """Locates the foot centres in the world (..., 4, 3; m), from q (..., 19) or x (..., 37)."""
    return _in_world(positions, foot_positions(robot, positions[..., quadruped.JOINT_POSITION]))


def lowest_body_points(robot: Robot, positions: Array, shank_share: float = 1.0) -> Array:
    """Locates the lowest points (..., 9, 3; m, in the world) of the boxes of `clearances`.

    For a limb, this is the lower end of its centre line. Next to a step, a corner of its box would
    seem to be inside the step.
    """
    up = -gravity_direction(positions[..., quadruped.QUATERNION])
    legs = leg_angles(positions[..., quadruped.JOINT_POSITION])
    thigh, knee, foot = leg_points(robot, legs)

    def lower(start: Array, end: Array) -> Array:
        descends = np.einsum("...lk,...k->...l", end - start, up) < 0.0
        return np.where(descends[..., None], end, start)

    # Level edges have no lower end; use their middle.
    corner = np.where(np.abs(up) < LEVEL, 0.0, np.sign(up))
    trunk = -0.5 * corner * np.array(robot.trunk_box)
    shank_end = knee + shank_share * (foot - knee)
    limbs = lower(thigh, knee), lower(knee, shank_end)
    lowest = np.concatenate([trunk[..., None, :], *limbs], axis=-2)
    return _in_world(positions, lowest)


class Clearances(NamedTuple):
    """Heights of the boxes, the feet and the trunk above the ground, and the trunk's lean."""

    body: Array  # lowest points of the trunk's, the thighs' and the calves' boxes (..., 9; m)
    feet: Array  # lowest points of the feet (..., 4; m)
    trunk: Array  # centre of the trunk (...; m)
    upright: Array  # cosine of the trunk's lean (...)


def clearances(robot: Robot, positions: Array, shank_share: float = 1.0) -> Clearances:
    """Measures the lowest points of the collision boxes, which must not touch, and of the feet.

    `shank_share` is the share of the calf's box, from the knee down, that is measured.
    """
    up = -gravity_direction(positions[..., quadruped.QUATERNION])
    base_height = positions[..., quadruped.POSITION][..., 2]
    legs = leg_angles(positions[..., quadruped.JOINT_POSITION])
    thigh_point, knee_point, foot_point = leg_points(robot, legs)

    # The upward axis in each leg's plane, and the lowest point of a box along a limb.
    up_x, up_y, up_z = up[..., 0:1], up[..., 1:2], up[..., 2:3]
    lateral = legs.cos_hip * up_y + legs.sin_hip * up_z
    vertical = -legs.sin_hip * up_y + legs.cos_hip * up_z

    def limb(start: Array, end: Array, sine: Array, cosine: Array, box: Box) -> Array:
        along = sine * up_x + cosine * vertical
        across = cosine * up_x - sine * vertical
        reach = np.abs(along) * box[0] + np.abs(lateral) * box[1] + np.abs(across) * box[2]
        centre = np.einsum("...lk,...k->...l", 0.5 * (start + end), up)
        return centre + base_height[..., None] - 0.5 * reach

    # Trunk, thighs and calves.
    trunk = base_height - 0.5 * np.abs(up) @ np.array(robot.trunk_box)
    thigh = limb(thigh_point, knee_point, legs.sin_thigh, legs.cos_thigh, robot.thigh_box)
    shank_end = knee_point + shank_share * (foot_point - knee_point)
    length, width, depth = robot.calf_box
    shank_box = (shank_share * length, width, depth)
    calf = limb(knee_point, shank_end, legs.sin_shank, legs.cos_shank, shank_box)
    return Clearances(
        body=np.concatenate([trunk[..., None], thigh, calf], axis=-1),
        feet=_heights_of_feet(robot, foot_point, up, base_height),
        trunk=base_height,
        upright=up[..., 2],
    )


def base_velocity(state: Array) -> tuple[Array, Array]:
    """Returns the trunk's linear and angular velocity (..., 3; m/s, rad/s) in the trunk's frame."""
    to_trunk = rotation_matrix(state[..., quadruped.QUATERNION]).swapaxes(-1, -2)
    linear = np.einsum("...ij,...j->...i", to_trunk, state[..., quadruped.LINEAR_VELOCITY])
    angular = np.einsum("...ij,...j->...i", to_trunk, state[..., quadruped.ANGULAR_VELOCITY])
    return linear, angular


def standing_state(robot: Robot, joint_position: Array | None = None) -> Array:
    """Returns states x (..., 37) of level robots at rest, with the lowest foot on the ground.

    Joint positions (..., 12; rad) are the default stance unless given.
    """
    if joint_position is None:
        joint_position = robot.default_stance
    state = np.zeros((*joint_position.shape[:-1], quadruped.N_POSITIONS + quadruped.N_VELOCITIES))
    state[..., 0] = 1.0
    state[..., quadruped.JOINT_POSITION] = joint_position
    state[..., 6] = -foot_heights(robot, state).min(axis=-1)
    return state


def moved_by(states: Array, offset: Array) -> Array:
    """Returns plant states x (..., 37) with the trunks moved by an offset (..., 3; m)."""
    if not offset.any():
        return states
    states = states.copy()
    states[..., quadruped.POSITION] += offset
    return states


def _unit_components(quaternion: Array) -> tuple[Array, Array, Array, Array]:
    # A discrete plant does not normalise its quaternion: after a minute of walking it is a tenth
    # too long.
    norm = np.sqrt(np.add.reduce(np.square(quaternion), axis=-1, keepdims=True))
    # All zeros stand for a non-finite state, which has no attitude.
    unit = quaternion / np.where(norm > 0.0, norm, 1.0)
    return unit[..., 0], unit[..., 1], unit[..., 2], unit[..., 3]
