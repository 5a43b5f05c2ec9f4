"""Readings of the inertial measurement unit (IMU) and of the feet's contact sensors.

A reading of the IMU over a control period is nine numbers: the gyroscope's angular velocity (3;
rad/s), the accelerometer's reading summed over the period, which is a change of velocity (3; m/s),
and the direction of gravity that the unit's filter computes from both (3; a unit vector). All are
in the trunk's frame.

Drake's `Accelerometer` measures the acceleration of the plant's last step; only the sum over the
period does not depend on the length of that step.
"""

from collections.abc import Callable, Sequence
from typing import Annotated, ClassVar, NamedTuple, Self

import numpy as np
from annotated_types import Ge, Le
from numpy.typing import NDArray

from glassgait.models import CONTROL_PERIOD
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.settings import NotNegative, Settings, checked

N_IMU = 9  # length of a reading

IMU_NOISE: Array = np.repeat([0.2, 0.3 * CONTROL_PERIOD, 0.05], 3)
"""Half-widths of the uniform noise of a reading (9; rad/s, m/s, no unit)."""
IMU_NOISE.flags.writeable = False

BoolArray = NDArray[np.bool_]

STUCK_OPEN, SOUND, STUCK_CLOSED = np.array([-1, 0, 1], dtype=np.int8)
"""States of a foot's contact sensor."""

UNCHANGED_STEPS = 50
"""Control steps without a change after which a contact sensor counts as stuck: a second, longer
than the slowest gait holds a foot up or down."""

LOW = 0.0075  # height below which a foot with a stuck sensor counts as touching (m)
UNREAD = np.int8(-1)  # reading of a sensor that was not read yet


class ImuReading(NamedTuple):
    """The parts of a reading, each (..., 3). At rest `velocity_change` is upward."""

    angular_velocity: Array
    velocity_change: Array
    gravity: Array

    @classmethod
    def of(cls, reading: Array) -> "ImuReading":
        """Splits a reading (..., 9)."""
        return cls(reading[..., 0:3], reading[..., 3:6], reading[..., 6:9])


@checked
class ImuErrors(Settings):
    """Errors of readings, besides their noise."""

    title: ClassVar[str] = "imu"

    # Greatest constant error of each angular velocity (rad/s).
    gyroscope_bias: Annotated[NotNegative, Le(10.0)] = 0.0
    # Greatest constant error of each acceleration (m/s²).
    accelerometer_bias: Annotated[NotNegative, Le(100.0)] = 0.0
    # Greatest constant error of each coordinate of gravity's direction.
    attitude_bias: Annotated[NotNegative, Le(1.0)] = 0.0
    delay: Annotated[int, Ge(0), Le(5)] = 0  # Delay of readings (control steps).

    @property
    def half_widths(self) -> Array:
        """Greatest constant errors of a reading (9; rad/s, m/s, no unit)."""
        velocity = self.accelerometer_bias * CONTROL_PERIOD
        return np.repeat([self.gyroscope_bias, velocity, self.attitude_bias], 3)


def measure_imu(state: Array, velocity_before: Array, gravity: Array) -> Array:
    """Returns the reading (..., 9) without errors, from the plant's state x (..., 37).

    The trunk's linear velocity one control period before (..., 3; m/s) and the acceleration by
    gravity (..., 3; m/s²) are in the world's frame.
    """
    to_trunk = kinematics.rotation_matrix(state[..., quadruped.QUATERNION]).swapaxes(-1, -2)
    change = state[..., quadruped.LINEAR_VELOCITY] - velocity_before - CONTROL_PERIOD * gravity
    world = np.empty((*state.shape[:-1], 3, 3))
    world[..., 0, :] = state[..., quadruped.ANGULAR_VELOCITY]
    world[..., 1, :] = change
    world[..., 2, :] = gravity / np.sqrt(np.add.reduce(np.square(gravity), axis=-1, keepdims=True))
    return np.einsum("...ij,...kj->...ki", to_trunk, world).reshape(*state.shape[:-1], N_IMU)


class ContactTrust(NamedTuple):
    """Last reading of each sensor (..., 4), and the control steps since it changed.

    Readings are 0, 1 or `UNREAD`. A sensor without a change for `UNCHANGED_STEPS` counts as stuck.
    """

    reading: NDArray[np.int8]
    unchanged: NDArray[np.int64]

    @classmethod
    def begin(cls, shape: tuple[int, ...] = ()) -> Self:
        """Returns the state before the first reading, for an array of robots."""
        feet = (*shape, quadruped.N_LEGS)
        return cls(np.full(feet, UNREAD), np.zeros(feet, dtype=np.int64))


def read_contacts(contact: BoolArray, wrong: BoolArray, stuck: NDArray[np.int8]) -> BoolArray:
    """Returns the sensors' readings (..., 4) of contacts: some are wrong in this step, or stuck."""
    return np.where(stuck == SOUND, contact ^ wrong, stuck == STUCK_CLOSED)


def stuck_sensors(is_open: Sequence[str], closed: Sequence[str]) -> NDArray[np.int8]:
    """Returns the state of each foot's sensor (4), from the legs whose sensors are stuck."""
    stuck = np.full(quadruped.N_LEGS, SOUND, dtype=np.int8)
    for legs, state in ((is_open, STUCK_OPEN), (closed, STUCK_CLOSED)):
        stuck[[quadruped.LEGS.index(leg) for leg in legs]] = state
    return stuck


class Contacts(NamedTuple):
    """Contacts of the feet, corrected for stuck sensors."""

    trust: ContactTrust
    contact: BoolArray  # which feet touch now or did in the previous step (..., 4)
    touching: BoolArray  # which feet touch now (..., 4)


def believed_contacts(
    before: ContactTrust, reading: BoolArray, expected_height: Callable[[], Array]
) -> Contacts:
    """Reads contact sensors (..., 4); the foot's height replaces a sensor that seems stuck.

    `expected_height` returns the heights (..., 4; m); it is only called if a sensor seems stuck.
    """
    read = reading.astype(np.int8)
    counted = np.minimum(before.unchanged + 1, UNCHANGED_STEPS)
    trust = ContactTrust(read, np.where(read == before.reading, counted, 0))
    # Remembering a contact for one step bridges a bouncing touch-down.
    lasting = reading | (before.reading == 1)
    stuck = trust.unchanged >= UNCHANGED_STEPS
    if not stuck.any():
        return Contacts(trust, lasting, reading)
    low = expected_height() < LOW
    return Contacts(trust, np.where(stuck, low, lasting), np.where(stuck, low, reading))
