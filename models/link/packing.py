"""What stands in the messages, as the arrays of this project."""

from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.link.messages import command_t, sensors_t, targets_t
from glassgait.models.link.watchdog import Answer
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command, CommandRange, on_the_spot, sound_command
from glassgait.models.task.day import REQUESTS
from glassgait.models.task.imu import ImuReading
from glassgait.models.task.request import NO_MODE

MICROSECONDS = 1e6

NOBODY = 0
"""Session of a message that was never sent: LCM's types are full of zeros at first."""


class Stamped(Protocol):
    """A message that says whose it is, which one, and of when."""

    session: int
    sequence: int
    utime: int


S = TypeVar("S", bound=Stamped)


def stamp(message: S, session: int, time: float) -> S:
    """Writes session, sequence and time (s, since the session's start) into a message."""
    message.session = session
    message.sequence = control_step(time)
    message.utime = round(MICROSECONDS * time)
    return message


def control_step(time: float) -> int:
    """Returns the number of a control instant (s)."""
    return round(time / CONTROL_PERIOD)


def pack_sensors(
    session: int,
    time: float,
    *,
    joints: Array,
    touching: NDArray[np.bool_],
    imu: Array,
    followed: bool,
) -> sensors_t:
    """Packs what the robot senses.

    Args:
        joints: Measured joint positions, then velocities (24; rad, rad/s).
        touching: Whether each foot presses on the ground (4).
        imu: The IMU's reading (9).
        followed: Whether the joints follow the targets.
    """
    message = stamp(sensors_t(), session, time)
    position, velocity = np.split(joints, 2)
    message.joint_position, message.joint_velocity = position.tolist(), velocity.tolist()
    message.foot_contact = touching.tolist()
    for part, own in ImuReading.of(imu)._asdict().items():
        setattr(message, part, own.tolist())
    message.followed = followed
    return message


def pack_command(session: int, time: float, command: Command, requested_mode: int = 0) -> command_t:
    """Packs what the robot is asked to do: velocities (2; m/s, rad/s), dwell, and of a day the
    number of what the operator requests."""
    message = stamp(command_t(), session, time)
    message.speed, message.yaw_rate = command.velocity.tolist()
    message.dwell = float(command.dwell)
    message.requested_mode = requested_mode
    return message


def pack_targets(
    answered: Stamped,
    targets: Array,
    *,
    damped: bool = False,
    mode: int = NO_MODE,
    day: str = "",
) -> targets_t:
    """Packs joint targets (12; rad) as the answer to a message of sensors.

    Args:
        answered: The message.
        targets: The targets.
        damped: Whether joints are to have no stiffness.
        mode: Number of the mode that the controller's day is in.
        day: Digest of that day; empty without one.
    """
    message = targets_t()
    message.session, message.sequence = answered.session, answered.sequence
    message.utime = answered.utime
    message.joint_position = targets.tolist()
    message.damped, message.mode, message.day = damped, mode, day
    return message


def unpack_joints(message: sensors_t) -> Array:
    """Returns measured joint positions, then velocities (24; rad, rad/s)."""
    return np.array([*message.joint_position, *message.joint_velocity])


def unpack_imu(message: sensors_t) -> Array:
    """Returns the IMU's reading (9)."""
    parts = [getattr(message, part) for part in ImuReading._fields]
    return np.concatenate(parts)


def unpack_touching(message: sensors_t) -> NDArray[np.bool_]:
    """Returns whether each foot presses on the ground (4)."""
    return np.array(message.foot_contact, dtype=bool)


def unpack_command(message: command_t, limits: CommandRange) -> Command:
    """Returns the command, the nearest that the gait is made for.

    Before the first message, and where a number is not finite, the robot is to step on the spot at
    the middle of the gait's rhythm.
    """
    if message.session == NOBODY:
        return on_the_spot(limits)
    velocity, dwell = np.array([message.speed, message.yaw_rate]), np.array(message.dwell)
    return sound_command(limits, Command(velocity, dwell))


def unpack_requested_mode(message: command_t) -> int:
    """Returns the number of what the operator requests; one that there is not is to sit."""
    requested = message.requested_mode
    return requested if 0 <= requested < len(REQUESTS) else REQUESTS.index("sit")


def unpack_answer(message: targets_t) -> Answer:
    """Returns what the robot's watchdog is to judge."""
    targets = np.array(message.joint_position, dtype=float)
    return Answer(message.session, message.utime / MICROSECONDS, targets, message.damped)
