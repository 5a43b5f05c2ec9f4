"""The reward of a control step, term by term."""

from dataclasses import fields
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array, cross, stacked
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, JointLaw, Robot
from glassgait.models.settings import NotNegative, Positive, Settings, checked
from glassgait.models.task import CONTROL_PERIOD

SOFT_LIMIT_FRACTION = 0.9  # share of a joint's range, about its middle, that costs nothing
AIR_TIME_TARGET = 0.5  # time in the air above which a step is rewarded (s)
HIGH_SWING = 0.1  # height of a foot up to which `high_swing` costs nothing (m)
STANDING_HEIGHT = 0.005  # height of a foot below which it should not move (m)
AIR_TIME_MIN_SPEED = 0.1  # commanded speed above which air time counts (m/s)


@checked
class RewardWeights(Settings):
    """Weights of a step's terms before the factor of 0.02 s, and settings of the tracking terms."""

    title: ClassVar[str] = "reward weights"

    # Weight of tracking the commanded forward speed, a Gaussian of the error.
    forward_tracking: float = 1.0
    # Weight of tracking the commanded yaw rate, a Gaussian of the error.
    yaw_tracking: float = 0.5
    vertical_velocity: float = -2.0  # Weight of the trunk's squared vertical velocity (s²/m²).
    roll_pitch_rate: float = -0.05  # Weight of the squared roll and pitch rates (s²/rad²).
    torque: float = -2e-4  # Weight of the squared joint torques (1/(N·m)²).
    joint_acceleration: float = -2.5e-7  # Weight of the squared joint accelerations (s⁴/rad²).
    action_change: float = -0.01  # Weight of the squared change of the action.
    # Weight of the angles beyond nine tenths of the joints' ranges (1/rad).
    joint_limits: float = -10.0
    # Weight of the landing feet's time in the air above its target (1/s).
    air_time: float = 1.0
    high_swing: float = 0.0  # Weight of the feet's heights above 0.1 m (1/m).
    tilt: float = 0.0  # Weight of the squared sine of the trunk's angle to the ground.
    slip: float = 0.0  # Weight of the squared speeds of the feet that are on the ground (s²/m²).
    # Squared width of the Gaussians of both tracking errors ((m/s)², (rad/s)²).
    tracking_width: Positive = 0.25
    # Time constant of a low-pass filter on the speeds that are compared with the command (s); 0 for
    # no filter.
    tracking_time: NotNegative = 0.0

    @cached_property
    def as_array(self) -> Array:
        """The weights (12) in the order of `REWARD_TERMS`."""
        return np.array([getattr(self, name) for name in REWARD_TERMS])


REWARD_TERMS = tuple(
    field.name for field in fields(RewardWeights) if not field.name.startswith("tracking_")
)


class Reward(NamedTuple):
    """The reward of one control step, and the memory for the next."""

    terms: Array  # weighted terms (..., 12), in the order of `REWARD_TERMS`
    plain: Array  # their sum times 0.02 s, at least 0 (...)
    air_time: Array  # time that each foot has been in the air (..., 4; s)
    tracked: Array  # filtered forward speed and yaw rate (..., 2; m/s, rad/s)


def tracked_speeds(linear: Array, angular: Array, before: Array, weights: RewardWeights) -> Array:
    """Filters forward speed and yaw rate (..., 2; m/s, rad/s) with a first-order low-pass.

    `linear` and `angular` are the trunk's velocities (..., 3; m/s, rad/s, trunk frame); `before` is
    the result of the previous control step.
    """
    now = stacked(linear[..., 0], angular[..., 2])
    if weights.tracking_time == 0.0:
        return now
    decay = np.exp(-CONTROL_PERIOD / weights.tracking_time)
    return decay * before + (1.0 - decay) * now


def step_reward(
    robot: Robot,
    state: Array,
    *,
    previous_joint_velocity: Array,
    action: Array,
    previous_action: Array,
    command: Array,
    foot_contact: NDArray[np.bool_],
    foot_height: Array,
    air_time: Array,
    tracked: Array,
    weights: RewardWeights,
    joint_law: JointLaw = DEFAULT_LAW,
) -> Reward:
    """Computes the reward of the step that led to the plant's state x (..., 37).

    Robots are along the leading axes of all arrays; units are m, rad, s and their quotients. The
    action was held during the step. `foot_contact` is true for feet that touch now or did at the
    previous step; `air_time` and `tracked` are from the previous step.
    """
    # How well the command is followed.
    linear, angular = kinematics.base_velocity(state)
    tracked = tracked_speeds(linear, angular, tracked, weights)
    exactness = np.exp(-np.square(command - tracked) / weights.tracking_width)

    # Feet that land after a long swing.
    air_time = air_time + CONTROL_PERIOD
    landed = foot_contact & (air_time > CONTROL_PERIOD)
    moving = np.abs(command[..., 0]) > AIR_TIME_MIN_SPEED
    flight = _total((air_time - AIR_TIME_TARGET) * landed) * moving

    # Joints: torques, accelerations, and angles near the ends of the ranges.
    position, velocity = state[..., quadruped.JOINT_POSITION], state[..., quadruped.JOINT_VELOCITY]
    torque = joint_law.torque(robot, action=action, position=position, velocity=velocity)
    acceleration = (velocity - previous_joint_velocity) / CONTROL_PERIOD
    excursion = np.abs(position - robot.middle) - SOFT_LIMIT_FRACTION * robot.half_range

    # Terms that take long to compute, only if they have a weight.
    slip = tilt = np.zeros_like(flight)
    if weights.slip:
        speed = _total(np.square(_foot_velocity(robot, state, linear, angular)))
        slip = _total(np.where(foot_height < STANDING_HEIGHT, speed, 0.0))
    if weights.tilt:
        down = kinematics.gravity_direction(state[..., quadruped.QUATERNION])
        tilt = _total(np.square(down[..., :2]))

    # All terms, in the order of `REWARD_TERMS`.
    values = (
        exactness[..., 0],
        exactness[..., 1],
        np.square(linear[..., 2]),
        _total(np.square(angular[..., :2])),
        _total(np.square(torque)),
        _total(np.square(acceleration)),
        _total(np.square(action - previous_action)),
        _total(np.maximum(excursion, 0.0)),
        flight,
        _total(np.maximum(foot_height - HIGH_SWING, 0.0)),
        tilt,
        slip,
    )
    terms = stacked(*values) * weights.as_array
    plain = np.maximum(_total(terms) * CONTROL_PERIOD, 0.0)
    air_time = np.where(foot_contact, 0.0, air_time)
    return Reward(terms=terms, plain=plain, air_time=air_time, tracked=tracked)


def _foot_velocity(robot: Robot, state: Array, linear: Array, angular: Array) -> Array:
    """Returns the velocities of the feet's lowest points (..., 4, 3; m/s, along the trunk's axes).

    The lowest point of a foot that rolls without slip is at rest; its centre moves.
    """
    position, velocity = state[..., quadruped.JOINT_POSITION], state[..., quadruped.JOINT_VELOCITY]
    motion = kinematics.foot_motion(robot, position, velocity)
    down = kinematics.gravity_direction(state[..., quadruped.QUATERNION])[..., None, :]
    turning = angular[..., None, :]
    of_centres = motion.velocity + linear[..., None, :] + cross(turning, motion.position)
    return of_centres + kinematics.rolling_velocity(robot, motion.turning + turning, down)


def _total(values: Array) -> Array:
    """Sums over the last axis; `np.sum` takes several times longer for one robot."""
    return np.add.reduce(values, axis=-1)
