"""A robot's motors as Unitree's messages have them: numbered, and driven by LowCmd.

Joints here are FL, FR, RL, RR, hip, thigh, calf. The messages have the legs in the robot's
`motor_order`. What goes from one to the other goes through `motor_numbers`, and nowhere else.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.link.unitree_messages import LOW_CMD, Record, seal
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS, N_JOINTS
from glassgait.models.robots.robot import Robot

HEAD, LOW_LEVEL = (0xFE, 0xEF), 0xFF
"""What every LowCmd begins with, as in the low-level examples of the SDK for quadrupeds."""

DRIVEN = 0x01
"""Mode of a motor that is driven."""

STIFFEST, MOST_DAMPED = 500.0, 50.0
"""Greatest gains that can be meant (N·m/rad, N·m·s/rad)."""

FASTEST = 100.0
"""Greatest velocity that can be meant (rad/s)."""


class MotorCommand(NamedTuple):
    """What joints are to do: torque = kp · (q - position) + kd · (dq - velocity) + tau.

    Attributes:
        q: Joint positions (12; rad).
        dq: Joint velocities (12; rad/s).
        tau: Torques (12; N·m).
        kp: Stiffness (12; N·m/rad).
        kd: Damping (12; N·m·s/rad).
    """

    q: Array
    dq: Array
    tau: Array
    kp: Array
    kd: Array

    @classmethod
    def to(cls, targets: Array, gains: tuple[float, float]) -> "MotorCommand":
        """Drives joints to targets (12; rad) by stiffness and damping."""
        kp, kd = (np.full(N_JOINTS, gain) for gain in gains)
        return cls(targets, np.zeros(N_JOINTS), np.zeros(N_JOINTS), kp, kd)

    @property
    def is_damping(self) -> bool:
        """Whether it only brakes."""
        return not self.kp.any()


def damping(position: Array, gain: float) -> MotorCommand:
    """Brakes joints wherever they go; the position (12; rad) has no effect."""
    return MotorCommand.to(position, (0.0, gain))


@cache
def foot_numbers(robot: Robot) -> NDArray[np.intp]:
    """Returns the number that messages give each leg FL, FR, RL, RR (4)."""
    return np.array([robot.motor_order.index(leg) for leg in LEGS])


@cache
def motor_numbers(robot: Robot) -> NDArray[np.intp]:
    """Returns the number that messages give the motor of each joint (12)."""
    motors = [f"{leg}_{joint}" for leg in robot.motor_order for joint in LEG_JOINTS]
    return np.array([motors.index(joint) for joint in JOINTS])


def pack_low_cmd(robot: Robot, command: MotorCommand) -> Record:
    """Returns the LowCmd of a command, with its checksum.

    Raises:
        ValueError: if it is no command that joints may be given; see `may_be_given`.
    """
    if not may_be_given(robot, command):
        raise ValueError("a motor command is not finite, or beyond what joints may be given")
    message = LOW_CMD.blank()
    message["head"], message["level_flag"] = HEAD, LOW_LEVEL
    numbers, motors = motor_numbers(robot), message["motor_cmd"]
    motors["mode"][numbers] = DRIVEN
    for name, values in command._asdict().items():
        motors[name][numbers] = values
    return seal(message)


def unpack_low_cmd(robot: Robot, message: Record) -> MotorCommand | None:
    """Returns the command of a LowCmd; None if one of the robot's motors is not driven."""
    motors = message["motor_cmd"][motor_numbers(robot)]
    if np.any(motors["mode"] != DRIVEN):
        return None
    return MotorCommand(*(motors[name].astype(float) for name in MotorCommand._fields))


def may_be_given(robot: Robot, command: MotorCommand) -> bool:
    """Decides whether joints may be given a command.

    All must be finite, gains neither negative nor beyond what can be meant, torques within the
    motors'. Where there is stiffness, positions must be within the joints' ranges, to what single
    precision rounds.
    """
    rounding = 1e-6
    low, high = robot.lower_limits - rounding, robot.upper_limits + rounding
    within = (command.q >= low) & (command.q <= high)
    loose = (command.kp == 0.0) & np.isfinite(command.q)
    gains = (command.kp >= 0.0) & (command.kp <= STIFFEST) & (command.kd >= 0.0)
    meant = (np.abs(command.tau) <= robot.effort) & (np.abs(command.dq) <= FASTEST)
    return bool(np.all((within | loose) & gains & (command.kd <= MOST_DAMPED) & meant))
