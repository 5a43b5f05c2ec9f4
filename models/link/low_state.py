"""What a robot senses, from Unitree's LowState messages and back.

LowState comes every 2 ms and says what is now; a controller here is asked every 20 ms, and its IMU
has summed the specific force since then. So the states of a control period are gathered one by one.
"""

import math
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.link.messages import sensors_t
from glassgait.models.link.motors import foot_numbers, motor_numbers
from glassgait.models.link.packing import MICROSECONDS
from glassgait.models.link.unitree_messages import LOW_STATE, Record, seal
from glassgait.models.robots import kinematics
from glassgait.models.robots.foot_force import FootForce
from glassgait.models.robots.quadruped import N_LEGS
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD

PERIOD = 0.002
"""Time from one LowState to the next (s)."""

TICKS = round(1e3 * PERIOD)
"""The same, in the messages' milliseconds."""

CONTROL_TICKS = round(1e3 * CONTROL_PERIOD)
"""A control period, in milliseconds."""

GREATEST = 1e6
"""Greatest number that is believed, as in exported controllers."""

_GREATEST_COUNT = np.iinfo(np.int16).max


def foot_force_of(robot: Robot) -> FootForce:
    """Returns how a robot's foot sensors are read.

    Raises:
        InputError: if its file does not say.
    """
    if robot.foot_force is None:
        raise InputError(
            f"{robot.path}: lacks foot_force, by which Unitree's messages say which feet touch; "
            "add it, as the robots that ship have it"
        )
    return robot.foot_force


def joints_of(robot: Robot, message: Record) -> Array:
    """Returns joint positions, then velocities (24; rad, rad/s)."""
    motors = message["motor_state"][motor_numbers(robot)]
    return np.concatenate([motors["q"], motors["dq"]]).astype(float)


def gravity_of(message: Record) -> Array:
    """Returns the direction of gravity in the trunk's frame (3), a unit vector."""
    return kinematics.gravity_direction(message["imu_state"]["quaternion"].astype(float))


def touching_of(robot: Robot, message: Record, before: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns which feet touch (4), FL FR RL RR, of which `before` (4) did at the state before.

    A foot touches from one force on, and until it falls to a lower one.
    """
    limits = foot_force_of(robot)
    counts = message["foot_force"][foot_numbers(robot)]
    return np.where(before, counts > limits.release, counts >= limits.touch)


def is_finite(message: Record) -> bool:
    """Returns whether all that is read of a LowState is finite, and its attitude is one."""
    imu, motors = message["imu_state"], message["motor_state"]
    names = ("quaternion", "gyroscope", "accelerometer")
    read = np.concatenate([*(imu[name] for name in names), motors["q"], motors["dq"]])
    length = float(np.square(imu["quaternion"].astype(float)).sum())
    # What is squared on the way must be finite then too.
    return bool(np.all(np.abs(read) < GREATEST)) and 0.25 < length < 4.0


class Gathered(NamedTuple):
    """What was gathered of the states since the last control instant.

    Attributes:
        velocity_change: Sum of the specific force (3; m/s).
        touching: Which feet touch (4).
        tick: Time of the latest state (ms); None before the first.
    """

    velocity_change: Array
    touching: NDArray[np.bool_]
    tick: int | None

    @classmethod
    def begin(cls) -> Self:
        """Returns what is known before the first state."""
        return cls(np.zeros(3), np.zeros(N_LEGS, dtype=bool), None)

    def after(self, robot: Robot, message: Record) -> Self:
        """Returns what is known after another state, later than the one before.

        The force of a state that was lost is taken to be that of the next one.
        """
        tick = int(message["tick"])
        elapsed = PERIOD if self.tick is None else 1e-3 * (tick - self.tick)
        force = message["imu_state"]["accelerometer"].astype(float)
        return type(self)(
            self.velocity_change + elapsed * force,
            touching_of(robot, message, self.touching),
            tick,
        )

    def at_control_instant(self) -> Self:
        """Returns what is known once a controller has been asked."""
        return self._replace(velocity_change=np.zeros(3))


def sensors_of(
    robot: Robot, message: Record, gathered: Gathered, sequence: int, *, followed: bool
) -> sensors_t:
    """Returns what a controller is asked.

    Args:
        robot: The robot.
        message: The state of the control instant.
        gathered: What was gathered up to it.
        sequence: Number of the control instant.
        followed: Whether the joints follow the controller's targets.
    """
    sensors = sensors_t()
    sensors.session, sensors.sequence = 1, sequence
    sensors.utime = round(MICROSECONDS * CONTROL_PERIOD * sequence)
    position, velocity = np.split(joints_of(robot, message), 2)
    sensors.joint_position, sensors.joint_velocity = position.tolist(), velocity.tolist()
    sensors.foot_contact = gathered.touching.tolist()
    sensors.angular_velocity = message["imu_state"]["gyroscope"].tolist()
    sensors.velocity_change = gathered.velocity_change.tolist()
    sensors.gravity = gravity_of(message).tolist()
    sensors.followed = followed
    return sensors


def pack_state(
    robot: Robot,
    tick: int,
    *,
    joints: Array,
    torque: Array,
    quaternion: Array,
    angular_velocity: Array,
    specific_force: Array,
    foot_force: Array,
    remote: bytes,
) -> Record:
    """Returns the LowState of what a robot senses, with its checksum.

    Args:
        robot: The robot.
        tick: Time (ms).
        joints: Measured joint positions, then velocities (24; rad, rad/s).
        torque: Joint torques (12; N·m).
        quaternion: The trunk's attitude (4; w, x, y, z), of any length.
        angular_velocity: What the gyroscope measures (3; rad/s).
        specific_force: What the accelerometer measures (3; m/s²).
        foot_force: Normal forces at the feet (4; N), FL FR RL RR.
        remote: The remote's bytes (40).
    """
    message = LOW_STATE.blank()
    message["head"], message["level_flag"], message["tick"] = (0xFE, 0xEF), 0xFF, tick
    imu, motors, numbers = message["imu_state"], message["motor_state"], motor_numbers(robot)
    imu["quaternion"] = quaternion / np.linalg.norm(quaternion)
    imu["rpy"] = roll_pitch_yaw(quaternion)
    imu["gyroscope"], imu["accelerometer"] = angular_velocity, specific_force
    motors["mode"][numbers] = 1
    motors["q"][numbers], motors["dq"][numbers] = np.split(joints, 2)
    motors["tau_est"][numbers] = torque
    counts = np.round(foot_force_of(robot).per_newton * foot_force)
    message["foot_force"][foot_numbers(robot)] = np.minimum(counts, _GREATEST_COUNT)
    message["wireless_remote"] = np.frombuffer(remote, np.uint8)
    return seal(message)


def roll_pitch_yaw(quaternion: Array) -> Array:
    """Returns roll, pitch and yaw (3; rad) of an attitude (4; w, x, y, z), of any length."""
    w, x, y, z = (quaternion / np.linalg.norm(quaternion)).tolist()
    roll = math.atan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    yaw = math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    return np.array([roll, math.asin(min(max(2 * (w * y - x * z), -1.0), 1.0)), yaw])
