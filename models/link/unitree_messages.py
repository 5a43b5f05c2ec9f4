"""Unitree's messages LowState and LowCmd: their fields, bytes and checksum.

Fields as in `unitree_go.msg.dds_` of Unitree's SDK (unitreerobotics/unitree_sdk2_python), types
LowState_, LowCmd_ and those they hold. A message here is a record of NumPy, laid out as C lays it
out in memory, since the checksum is of those bytes. The bytes on the wire are the same numbers in
the same order, with other gaps. The SDK's own classes take 1.3 ms of a processor to read, check
and write one message each; at 500 Hz that is most of a core.
"""

import zlib
from collections.abc import Iterator
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

N_MOTORS = 20
"""Motors that a message has room for; a quadruped's are the first 12."""

N_REMOTE = 40
"""Bytes of the robot's own remote."""

Record = NDArray[np.void]
"""One message: an array without dimensions."""

Field = tuple[str, Any] | tuple[str, Any, int]

LITTLE_ENDIAN = (b"\x00\x01", b"\x00\x07")
"""What the wire's bytes begin with: plain CDR of version 1 and 2, which are the same here."""

_HEADER = 4
"""Bytes ahead of a message's own: how it is encoded, and options."""

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


class MessageType:
    """A kind of message.

    Attributes:
        name: Its name on the wire.
        dtype: Its fields, in memory.
        parts: The types of the fields that are messages themselves, by field.
    """

    def __init__(self, name: str, fields: list[Field], **parts: "MessageType") -> None:
        """
        Args:
            name: Its name within `unitree_go.msg.dds_`.
            fields: Name, type and, where there are several, number of each field.
            parts: Types of the fields that are messages themselves.
        """
        self.name, self.parts = f"unitree_go.msg.dds_.{name}", parts
        self.dtype = np.dtype(fields, align=True)

    def blank(self) -> Record:
        """Returns a message full of zeros."""
        return np.zeros((), self.dtype)

    def to_wire(self, message: Record) -> bytes:
        """Returns the bytes on the wire."""
        wire = np.zeros(self.wire_size, np.uint8)
        in_memory, on_wire = _places(self.dtype)
        wire[on_wire] = np.frombuffer(message.tobytes(), np.uint8)[in_memory]
        return LITTLE_ENDIAN[0] + b"\x00\x00" + wire.tobytes()

    def from_wire(self, data: bytes) -> Record:
        """Reads the bytes of a message.

        Raises:
            ValueError: if they are none of this type.
        """
        if len(data) != _HEADER + self.wire_size or data[:2] not in LITTLE_ENDIAN:
            raise ValueError(f"{len(data)} bytes are no {self.name}")
        memory = np.zeros(self.dtype.itemsize, np.uint8)
        in_memory, on_wire = _places(self.dtype)
        memory[in_memory] = np.frombuffer(data, np.uint8, offset=_HEADER)[on_wire]
        return memory.view(self.dtype).reshape(())

    @cached_property
    def wire_size(self) -> int:
        """Bytes on the wire, without what they begin with."""
        _, on_wire = _places(self.dtype)
        return 4 * -(-(int(on_wire[-1]) + 1) // 4)


@cache
def _places(dtype: np.dtype[Any]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Returns the places of all bytes that hold something, in memory and on the wire."""
    in_memory, on_wire = [], []
    end = 0
    for place, size in _scalars(dtype, 0):
        begin = -(-end // size) * size
        end = begin + size
        in_memory.extend(range(place, place + size))
        on_wire.extend(range(begin, end))
    return np.array(in_memory), np.array(on_wire)


def _scalars(dtype: np.dtype[Any], place: int) -> Iterator[tuple[int, int]]:
    """Lists place and size of every number, in memory and in the order of the fields."""
    if dtype.subdtype is not None:
        element, shape = dtype.subdtype
        for index in range(int(np.prod(shape))):
            yield from _scalars(element, place + index * element.itemsize)
    elif dtype.fields is not None:
        for part, offset, *_ in dtype.fields.values():
            yield from _scalars(part, place + offset)
    else:
        yield place, dtype.itemsize


IMU_STATE = MessageType(
    "IMUState_",
    [
        ("quaternion", "<f4", 4),
        ("gyroscope", "<f4", 3),
        ("accelerometer", "<f4", 3),
        ("rpy", "<f4", 3),
        ("temperature", "u1"),
    ],
)

MOTOR_STATE = MessageType(
    "MotorState_",
    [
        ("mode", "u1"),
        ("q", "<f4"),
        ("dq", "<f4"),
        ("ddq", "<f4"),
        ("tau_est", "<f4"),
        ("q_raw", "<f4"),
        ("dq_raw", "<f4"),
        ("ddq_raw", "<f4"),
        ("temperature", "u1"),
        ("lost", "<u4"),
        ("reserve", "<u4", 2),
    ],
)

MOTOR_CMD = MessageType(
    "MotorCmd_",
    [
        ("mode", "u1"),
        ("q", "<f4"),
        ("dq", "<f4"),
        ("tau", "<f4"),
        ("kp", "<f4"),
        ("kd", "<f4"),
        ("reserve", "<u4", 3),
    ],
)

BMS_STATE = MessageType(
    "BmsState_",
    [
        ("version_high", "u1"),
        ("version_low", "u1"),
        ("status", "u1"),
        ("soc", "u1"),
        ("current", "<i4"),
        ("cycle", "<u2"),
        ("bq_ntc", "u1", 2),
        ("mcu_ntc", "u1", 2),
        ("cell_vol", "<u2", 15),
    ],
)

BMS_CMD = MessageType("BmsCmd_", [("off", "u1"), ("reserve", "u1", 3)])

_BEGIN: list[Field] = [
    ("head", "u1", 2),
    ("level_flag", "u1"),
    ("frame_reserve", "u1"),
    ("sn", "<u4", 2),
    ("version", "<u4", 2),
    ("bandwidth", "<u2"),
]

LOW_STATE = MessageType(
    "LowState_",
    [
        *_BEGIN,
        ("imu_state", IMU_STATE.dtype),
        ("motor_state", MOTOR_STATE.dtype, N_MOTORS),
        ("bms_state", BMS_STATE.dtype),
        ("foot_force", "<i2", 4),
        ("foot_force_est", "<i2", 4),
        ("tick", "<u4"),
        ("wireless_remote", "u1", N_REMOTE),
        ("bit_flag", "u1"),
        ("adc_reel", "<f4"),
        ("temperature_ntc1", "u1"),
        ("temperature_ntc2", "u1"),
        ("power_v", "<f4"),
        ("power_a", "<f4"),
        ("fan_frequency", "<u2", 4),
        ("reserve", "<u4"),
        ("crc", "<u4"),
    ],
    imu_state=IMU_STATE,
    motor_state=MOTOR_STATE,
    bms_state=BMS_STATE,
)

LOW_CMD = MessageType(
    "LowCmd_",
    [
        *_BEGIN,
        ("motor_cmd", MOTOR_CMD.dtype, N_MOTORS),
        ("bms_cmd", BMS_CMD.dtype),
        ("wireless_remote", "u1", N_REMOTE),
        ("led", "u1", 12),
        ("fan", "u1", 2),
        ("gpio", "u1"),
        ("reserve", "<u4"),
        ("crc", "<u4"),
    ],
    motor_cmd=MOTOR_CMD,
    bms_cmd=BMS_CMD,
)


def checksum(message: Record) -> int:
    """Returns the CRC of a message that ends in one.

    It is that of the SDK's class CRC: polynomial 0x04C11DB7, begun with ones, over the words of 32
    bits before the last, each from its highest bit. That is CRC-32/MPEG-2 over bytes of which every
    four are turned round, and `zlib`'s over bits that are.
    """
    in_memory, _ = _places(message.dtype)
    memory = np.zeros(message.dtype.itemsize, np.uint8)
    # NumPy does not copy what lies between fields, which is to be zero.
    memory[in_memory] = np.frombuffer(message.tobytes(), np.uint8)[in_memory]
    words = memory.view("<u4")[:-1]
    mirrored = words.astype(">u4").tobytes().translate(_REVERSED)
    return int(f"{zlib.crc32(mirrored) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def seal(message: Record) -> Record:
    """Writes a message's checksum into it, and returns it."""
    message["crc"] = checksum(message)
    return message


def is_sound(message: Record) -> bool:
    """Returns whether a message's checksum is right."""
    return int(message["crc"]) == checksum(message)
