"""Leg odometry: estimates the body state from the IMU, the joints and the standing feet.

The lowest point of a standing foot is at rest (its centre is not, since the foot rolls), so the
joints give the trunk's velocity. A linear filter with one gain predicts the velocity from the
accelerometer and corrects it by the standing feet. The ground is the plane of the footholds, the
places where the feet stood last. The filter is modelled on the legged odometry of Bloesch et al.
(*State Estimation for Legged Robots*, 2012) and the linear Kalman filter of the Mini Cheetah (Bledt
et al., 2018), whose gains converge to constants.
"""

import hashlib
import json
from dataclasses import asdict
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Gt, Le
from numpy.typing import NDArray

from glassgait.models import BASE_VELOCITY_SCALE, CONTROL_PERIOD, GRAVITY
from glassgait.models.arrays import Array, cross
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings, checked

SLIP = 1.0  # speed over the ground from which a foot does not count as standing (m/s)


class OdometryState(NamedTuple):
    """The state of odometry between two control steps, in the trunk's frame."""

    velocity: Array  # the trunk's (..., 3; m/s)
    footholds: Array  # places where the feet stand, or stood last (..., 4, 3; m)
    touching: NDArray[np.bool_]  # which feet seemed to press on the ground (..., 4)
    turning: Array  # the trunk's angular velocity (..., 3; rad/s)


@checked
class Odometry(Settings):
    """Estimates velocity and foot heights."""

    title: ClassVar[str] = "odometry"

    # Share of the difference between the velocity by the standing feet and the predicted one that
    # is added to the prediction in a control step.
    gain: Annotated[float, Gt(0.0), Le(1.0)] = 0.15

    def digest(self) -> str:
        """Returns a digest of the settings."""
        return hashlib.sha256(json.dumps(asdict(self)).encode()).hexdigest()[:16]

    def begin(self, robot: Robot, joint_position: Array) -> OdometryState:
        """Returns the state of robots at rest on all feet, from joint positions (..., 12; rad)."""
        feet = kinematics.foot_positions(robot, joint_position)
        rest = np.zeros((*feet.shape[:-2], 3))
        return OdometryState(rest, feet, np.zeros(feet.shape[:-1], dtype=bool), rest)

    def advance(
        self,
        robot: Robot,
        before: OdometryState,
        *,
        joint_position: Array,
        joint_velocity: Array,
        imu: Array,
        touching: NDArray[np.bool_],
    ) -> OdometryState:
        """Advances by a control step.

        A foot counts as standing if it touches now and did in the previous step: a foot that has
        just landed still moves. It must also be nearly at rest at the predicted velocity, because a
        foot that swings or slips may read a contact; this is waived if no foot is nearly at rest.

        The arguments are measured joint positions and velocities (..., 12; rad, rad/s), the IMU's
        reading (..., 9), and the feet that seem to press on the ground (..., 4).
        """
        turned_by, change, gravity = imu[..., 0:3], imu[..., 3:6], imu[..., 6:9]
        feet, swept, rolling = kinematics.foot_motion(robot, joint_position, joint_velocity)
        # Velocities of the soles relative to the trunk's centre. One cross product turns all
        # vectors, because the overhead of a NumPy call dominates.
        vectors = [feet, before.footholds, before.velocity[..., None, :]]
        turned = cross(turned_by[..., None, :], np.concatenate(vectors, axis=-2))
        turning = rolling + turned_by[..., None, :]
        rolled = kinematics.rolling_velocity(robot, turning, gravity[..., None, :])
        sole = swept + turned[..., : quadruped.N_LEGS, :] + rolled

        # The velocity predicted from the accelerometer, corrected by the standing feet.
        free = change + CONTROL_PERIOD * GRAVITY * gravity
        predicted = before.velocity - CONTROL_PERIOD * turned[..., -1, :] + free
        stood = touching & before.touching
        over_ground = sole + predicted[..., None, :]
        at_rest = stood & (np.add.reduce(np.square(over_ground), axis=-1) < SLIP * SLIP)
        # If no foot is nearly at rest, the prediction is wrong.
        standing = np.where(at_rest.any(axis=-1, keepdims=True), at_rest, stood)
        count = np.asarray(standing.sum(axis=-1))[..., None]
        of_feet = -np.where(standing[..., None], sole, 0.0).sum(axis=-2) / np.maximum(count, 1)
        correction = self.gain * (of_feet - predicted)
        velocity = predicted + np.where(count > 0, correction, 0.0)

        # Footholds move with the ground under the trunk.
        moved = _moved(before.footholds, velocity, turned[..., quadruped.N_LEGS : -1, :])
        footholds = np.where(touching[..., None], feet, moved)
        return OdometryState(velocity, footholds, touching, turned_by)

    def expected_heights(self, robot: Robot, before: OdometryState, joint_position: Array) -> Array:
        """Predicts the heights of the feet (..., 4; m) before their contacts are known.

        The ground is that of the previous control step, moved under the trunk.
        """
        turned = cross(before.turning[..., None, :], before.footholds)
        moved = _moved(before.footholds, before.velocity, turned)
        return _heights(kinematics.foot_positions(robot, joint_position), moved)

    def body_state(self, robot: Robot, state: OdometryState, joint_position: Array) -> Array:
        """Returns the observed estimate (..., 7): velocity scaled by 2, and heights of the feet.

        The ground is the plane through the mean of the four footholds whose normal is the cross
        product of their diagonals. Units are m/s in the trunk's frame, and m.
        """
        heights = _heights(kinematics.foot_positions(robot, joint_position), state.footholds)
        return np.concatenate([BASE_VELOCITY_SCALE * state.velocity, heights], axis=-1)


def _moved(footholds: Array, velocity: Array, turned: Array) -> Array:
    """Moves footholds (..., 4, 3; m) as the ground moves under the trunk in a control step."""
    return footholds - CONTROL_PERIOD * (velocity[..., None, :] + turned)


def _heights(feet: Array, footholds: Array) -> Array:
    """Returns the heights of feet (..., 4; m) above the plane of footholds (..., 4, 3; m)."""
    # From each rear foot to the front foot on the other side.
    diagonals = footholds[..., :2, :] - footholds[..., :1:-1, :]
    normal = cross(diagonals[..., 1, :], diagonals[..., 0, :])
    normal = normal / np.sqrt(np.add.reduce(np.square(normal), axis=-1, keepdims=True))
    middle = np.add.reduce(footholds, axis=-2, keepdims=True) / quadruped.N_LEGS
    return np.add.reduce((feet - middle) * normal[..., None, :], axis=-1)
