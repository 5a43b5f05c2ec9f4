"""Unitree's messages: their bytes and checksums, compared with what Unitree's SDK makes of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.link.dds import idl_struct
from glassgait.models.link.unitree_messages import (
    LOW_CMD,
    LOW_STATE,
    checksum,
    is_sound,
    seal,
)

KINDS = {"LowState_": LOW_STATE, "LowCmd_": LOW_CMD}

TYPES = {"LowState_": "ef1819d05896c24741d6dbde9167", "LowCmd_": "12da99179559f14db8b7ab23acdd"}
"""Hashes of the types of unitree-sdk2py-dimos 1.0.3, by which DDS decides whether ends match."""

CHECKSUMS = {"LowState_": 1004036487, "LowCmd_": 1264208000}
"""Checksums by the SDK of messages full of zeros; the state's tick is 7."""


def message_of(kind, seed):
    """Returns a message of random numbers; those of the battery's sensors are below 128.

    The SDK's checksum raises where they are not: it packs what is unsigned as signed.
    """
    generator = np.random.default_rng(seed)
    data = generator.integers(0, 128, kind.wire_size, dtype=np.uint8)
    return kind.from_wire(b"\x00\x01\x00\x00" + data.tobytes())


@pytest.mark.parametrize("name", KINDS)
def test_the_sizes_are_those_that_the_sdk_packs(name):
    assert KINDS[name].dtype.itemsize == {"LowState_": 1180, "LowCmd_": 812}[name]


@pytest.mark.parametrize("name", KINDS)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_message_comes_out_as_it_went_in(name, seed):
    kind = KINDS[name]
    message = message_of(kind, seed)
    again = kind.from_wire(kind.to_wire(message))
    assert again.tobytes() == message.tobytes()


@pytest.mark.parametrize("name", KINDS)
def test_checksums_are_the_sdks(name):
    message = KINDS[name].blank()
    if name == "LowState_":
        message["tick"] = 7
    assert checksum(message) == CHECKSUMS[name]


@pytest.mark.parametrize("name", KINDS)
@given(seed=st.integers(0, 2**32 - 1), bit=st.integers(0, 7), share=st.floats(0, 1))
def test_one_wrong_bit_is_noticed(name, seed, bit, share):
    kind = KINDS[name]
    message = seal(message_of(kind, seed))
    assert is_sound(message)
    data = bytearray(kind.to_wire(message))
    place = 4 + round(share * (kind.wire_size - 1))
    data[place] ^= 1 << bit
    wrong = kind.from_wire(bytes(data))
    # What lies between fields is not read.
    assert is_sound(wrong) == (wrong == message)


def test_a_copy_has_the_same_checksum():
    """NumPy leaves what lies between fields as it is found."""
    messages = np.full(3, 255, np.uint8).repeat(LOW_CMD.dtype.itemsize).view(LOW_CMD.dtype)
    messages[1] = seal(message_of(LOW_CMD, 3))
    assert is_sound(messages[1].copy().reshape(()))


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", b"nonsense" * 200])
def test_other_bytes_are_no_message(data):
    with pytest.raises(ValueError, match="are no unitree_go"):
        LOW_STATE.from_wire(data)


def test_the_bytes_of_the_other_byte_order_are_no_message():
    data = bytearray(LOW_STATE.to_wire(LOW_STATE.blank()))
    data[1] = 0
    with pytest.raises(ValueError, match="are no"):
        LOW_STATE.from_wire(bytes(data))


@pytest.mark.parametrize("name", KINDS)
def test_types_match_those_of_robots(name):
    pytest.importorskip("cyclonedds", reason="needs the extra unitree")
    idl = idl_struct(KINDS[name]).__idl__
    idl.populate()
    idl.fill_type_data()
    assert bytes(idl.get_type_id().value).hex() == TYPES[name]


@pytest.mark.parametrize("name", KINDS)
def test_bytes_and_checksums_are_what_the_sdk_makes(name):
    sdk = pytest.importorskip(
        "unitree_sdk2py.idl.unitree_go.msg.dds_", reason="needs unitree-sdk2py-dimos, without deps"
    )
    from unitree_sdk2py.utils.crc import CRC  # noqa: PLC0415

    kind, theirs = KINDS[name], getattr(sdk, name)
    for seed in range(20):
        message = message_of(kind, seed)
        wire = kind.to_wire(message)
        read = theirs.deserialize(wire)
        assert read.serialize().ljust(len(wire), b"\x00") == wire
        assert CRC().Crc(read) == checksum(message)
        assert kind.from_wire(wire).tobytes() == message.tobytes()
