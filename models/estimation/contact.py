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
"""What is known of a sensor that was not read yet."""


class ContactTrust(NamedTuple):
    """What distinguishes stuck sensors from sound ones.

    Attributes:
        reading: What each sensor read at the step before (..., 4): 0, 1, or `UNREAD`.
        unchanged: Control steps since it last changed (..., 4), `UNCHANGED_STEPS` at most.
    """

    reading: NDArray[np.int8]
    unchanged: NDArray[np.int64]

    @classmethod
    def begin(cls, shape: tuple[int, ...] = ()) -> Self:
        """Returns what is known of sensors before they are read, of robots of that shape."""
        feet = (*shape, quadruped.N_LEGS)
        return cls(np.full(feet, UNREAD), np.zeros(feet, dtype=np.int64))

    def after(self, reading: BoolArray) -> Self:
        """Returns what is known once the sensors have been read (..., 4)."""
        read = reading.astype(np.int8)
        counted = np.minimum(self.unchanged + 1, UNCHANGED_STEPS)
        return type(self)(read, np.where(read == self.reading, counted, 0))

    def lasting(self, reading: BoolArray) -> BoolArray:
        """Returns which feet touch, or did at the step before, as the sensors read them (..., 4).

        The memory of one step bridges a bouncing touch-down.

        Args:
            reading: What the sensors read after the step that this knows of (..., 4).
        """
        return reading | (self.reading == 1)

    @property
    def doubted(self) -> BoolArray:
        """Which sensors are not believed (..., 4)."""
        return self.unchanged >= UNCHANGED_STEPS

    def believed(self, contact: BoolArray, height: Array) -> BoolArray:
        """Returns which feet touch, as sensors that are believed say, and else their heights.

        Args:
            contact: Which feet touch, as the sensors have it (..., 4).
            height: Height of each foot above the ground (..., 4; m).
        """
        return np.where(self.doubted, height < LOW, contact)


def read_contacts(contact: BoolArray, wrong: BoolArray, stuck: NDArray[np.int8]) -> BoolArray:
    """Reads contacts by sensors that are wrong now and then, or always the same.

    Args:
        contact: Whether each foot touches (..., 4).
        wrong: Whether each sensor reads wrongly at this instant (..., 4).
        stuck: What each sensor always reads (..., 4): `STUCK_OPEN` no contact, `STUCK_CLOSED`
            contact; one that is `SOUND` reads what there is.
    """
    return np.where(stuck == SOUND, contact ^ wrong, stuck == STUCK_CLOSED)


def stuck_sensors(is_open: Sequence[str], closed: Sequence[str]) -> NDArray[np.int8]:
    """Returns the state of each foot's sensor (4), of which some are stuck.

    Args:
        is_open: Legs whose sensors never read a contact.
        closed: Legs whose sensors always do.
    """
    stuck = np.full(quadruped.N_LEGS, SOUND, dtype=np.int8)
    for legs, state in ((is_open, STUCK_OPEN), (closed, STUCK_CLOSED)):
        stuck[[quadruped.LEGS.index(leg) for leg in legs]] = state
    return stuck


class Contacts(NamedTuple):
    """Contacts as far as sensors are believed.

    Attributes:
        trust: Which sensors are believed.
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
        before: What is known of the sensors from the step before.
        reading: Whether each sensor reads a contact (..., 4).
        expected_height: Returns how high the feet are (..., 4; m); called only if needed.
    """
    trust, lasting = before.after(reading), before.lasting(reading)
    if not trust.doubted.any():
        return Contacts(trust, lasting, reading)
    height = expected_height()
    return Contacts(trust, trust.believed(lasting, height), trust.believed(reading, height))
