"""Readings of an inertial measurement unit (IMU) in the trunk over a control period.

A reading is nine numbers: the gyroscope's angular velocity (3; rad/s), the accelerometer's reading
summed over the control period, which is a change of velocity (3; m/s), and the direction of gravity
that the unit's filter makes of both (3; a unit vector). All are in the trunk's frame.

Drake's `Accelerometer` measures the acceleration of the plant's last step, however long it is; only
its sum over the period is the same for all plants.
"""

from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from annotated_types import Ge, Le

from glassgait.models import CONTROL_PERIOD
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.settings import NotNegative, Settings, checked

GRAVITY = 9.81
"""Acceleration by gravity (m/s²)."""

N_IMU = 9
"""Length of a reading."""

IMU_NOISE: Array = np.repeat([0.2, 0.3 * CONTROL_PERIOD, 0.05], 3)
"""Half-widths of the uniform noise of a reading (9; rad/s, m/s, none)."""
IMU_NOISE.flags.writeable = False

MOST_DELAY = 5
"""Greatest delay of a reading (control steps)."""


class ImuReading(NamedTuple):
    """The parts of a reading, in the trunk's frame.

    Attributes:
        angular_velocity: Angular velocity (..., 3; rad/s).
        velocity_change: Sum of the specific force over the control period (..., 3; m/s): at rest
            the period times gravity, upward.
        gravity: Direction of gravity (..., 3), a unit vector but for its noise.
    """

    angular_velocity: Array
    velocity_change: Array
    gravity: Array

    @classmethod
    def of(cls, reading: Array) -> "ImuReading":
        """Takes a reading (..., 9) apart."""
        return cls(reading[..., 0:3], reading[..., 3:6], reading[..., 6:9])


@checked
class ImuErrors(Settings):
    """Errors of readings, besides their noise.

    Attributes:
        gyroscope_bias: Greatest constant error of each angular velocity (rad/s).
        accelerometer_bias: Greatest constant error of each acceleration (m/s²).
        attitude_bias: Greatest constant error of each coordinate of gravity's direction.
        delay: Control steps by which readings are late.
    """

    title: ClassVar[str] = "imu"

    gyroscope_bias: Annotated[NotNegative, Le(10.0)] = 0.0
    accelerometer_bias: Annotated[NotNegative, Le(100.0)] = 0.0
    attitude_bias: Annotated[NotNegative, Le(1.0)] = 0.0
    delay: Annotated[int, Ge(0), Le(MOST_DELAY)] = 0

    @property
    def half_widths(self) -> Array:
        """Greatest constant errors of a reading (9; rad/s, m/s, none)."""
        velocity = self.accelerometer_bias * CONTROL_PERIOD
        return np.repeat([self.gyroscope_bias, velocity, self.attitude_bias], 3)


def measure_imu(
    state: Array, velocity_before: Array, gravity: Array, period: float = CONTROL_PERIOD
) -> Array:
    """Returns the reading (..., 9) without errors.

    Args:
        state: The plant's state x (..., 37).
        velocity_before: The trunk's linear velocity one period before (..., 3; m/s, world frame).
        gravity: Acceleration by gravity (..., 3; m/s², world frame).
        period: Time over which the specific force is summed (s).
    """
    to_trunk = kinematics.rotation_matrix(state[..., quadruped.QUATERNION]).swapaxes(-1, -2)
    change = state[..., quadruped.LINEAR_VELOCITY] - velocity_before - period * gravity
    world = np.empty((*state.shape[:-1], 3, 3))
    world[..., 0, :] = state[..., quadruped.ANGULAR_VELOCITY]
    world[..., 1, :] = change
    world[..., 2, :] = gravity / np.sqrt(np.add.reduce(np.square(gravity), axis=-1, keepdims=True))
    return np.einsum("...ij,...kj->...ki", to_trunk, world).reshape(*state.shape[:-1], N_IMU)
