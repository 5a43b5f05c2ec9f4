"""Contact sensors of the feet: errors of their readings, and which of them are believed."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped

BoolArray = NDArray[np.bool_]

STUCK_OPEN, SOUND, STUCK_CLOSED = np.array([-1, 0, 1], dtype=np.int8)
"""States of a foot's contact sensor."""

UNCHANGED_STEPS = 50
"""Control steps without a change after which a contact sensor is not believed: a second, longer
than the slowest gait holds a foot up or down."""

LOW = 0.0075
"""Height below which the foot of such a sensor is taken to touch (m)."""

UNREAD = np.int8(-1)
"""Reading of a sensor before it was read for the first time."""


class ContactTrust(NamedTuple):
    """Memory of the contact sensors, which distinguishes stuck sensors from sound ones.

    Attributes:
        reading: What each sensor read at the step before (..., 4): 0, 1, or `UNREAD`.
        unchanged: Control steps since it last changed (..., 4), `UNCHANGED_STEPS` at most.
    """

    reading: NDArray[np.int8]
    unchanged: NDArray[np.int64]

    @classmethod
    def begin(cls, shape: tuple[int, ...] = ()) -> Self:
        """Returns the memory before sensors are read, of robots of that shape."""
        feet = (*shape, quadruped.N_LEGS)
        return cls(np.full(feet, UNREAD), np.zeros(feet, dtype=np.int64))

    def after(self, reading: BoolArray) -> Self:
        """Returns the memory once the sensors have been read (..., 4)."""
        read = reading.astype(np.int8)
        counted = np.minimum(self.unchanged + 1, UNCHANGED_STEPS)
        return type(self)(read, np.where(read == self.reading, counted, 0))

    def lasting(self, reading: BoolArray) -> BoolArray:
        """Returns which feet touch, or did at the step before (..., 4), by new readings (..., 4).

        The memory of one step bridges a bouncing touch-down.
        """
        return reading | (self.reading == 1)

    @property
    def doubted(self) -> BoolArray:
        """Sensors that are not believed (..., 4)."""
        return self.unchanged >= UNCHANGED_STEPS

    def believed(self, contact: BoolArray, height: Array) -> BoolArray:
        """Returns which feet touch (..., 4), by heights (..., 4; m) where a sensor is doubted."""
        return np.where(self.doubted, height < LOW, contact)


def read_contacts(contact: BoolArray, wrong: BoolArray, stuck: NDArray[np.int8]) -> BoolArray:
    """Returns readings (..., 4) of contacts by sensors that are wrong now and then, or stuck."""
    return np.where(stuck == SOUND, contact ^ wrong, stuck == STUCK_CLOSED)


def stuck_sensors(is_open: Sequence[str], closed: Sequence[str]) -> NDArray[np.int8]:
    """Returns the state of each foot's sensor (4), from the legs whose sensors are stuck."""
    stuck = np.full(quadruped.N_LEGS, SOUND, dtype=np.int8)
    for legs, state in ((is_open, STUCK_OPEN), (closed, STUCK_CLOSED)):
        stuck[[quadruped.LEGS.index(leg) for leg in legs]] = state
    return stuck


class Contacts(NamedTuple):
    """Contacts as far as sensors are believed.

    Attributes:
        trust: Memory of the sensors.
        contact: Which feet touch, or did at the step before (..., 4).
        touching: Which feet touch now (..., 4).
    """

    trust: ContactTrust
    contact: BoolArray
    touching: BoolArray


def believed_contacts(
    before: ContactTrust, reading: BoolArray, expected_height: Callable[[], Array]
) -> Contacts:
    """Reads contact sensors, and takes the feet's heights where a sensor seems to be stuck.

    Args:
        before: Memory of the sensors at the step before.
        reading: Whether each sensor reads a contact (..., 4).
        expected_height: Returns the heights of the feet (..., 4; m); called only if needed.
    """
    trust, lasting = before.after(reading), before.lasting(reading)
    if not trust.doubted.any():
        return Contacts(trust, lasting, reading)
    height = expected_height()
    return Contacts(trust, trust.believed(lasting, height), trust.believed(reading, height))
