"""The robot's own remote: its bytes, its sticks and its buttons."""

import struct

import numpy as np
import pytest

from glassgait.models.link.remote import (
    Button,
    Remote,
    Sticks,
    read_remote,
    remote_command,
    write_remote,
)

NOTHING = Button(0)


def remote(buttons=NOTHING, **sticks):
    return Remote(buttons, **({"lx": 0.0, "ly": 0.0, "rx": 0.0, "ry": 0.0} | sticks))


def test_bytes_are_read_where_the_sdk_has_them():
    data = bytearray(40)
    data[2], data[3] = 0b0010_0000, 0b0000_0010
    for place, stick in ((4, 0.1), (8, 0.2), (12, 0.3), (20, 0.4)):
        data[place : place + 4] = struct.pack("<f", stick)
    read = read_remote(bytes(data))
    assert read.buttons == Button.L2 | Button.B
    np.testing.assert_allclose((read.lx, read.rx, read.ry, read.ly), (0.1, 0.2, 0.3, 0.4), 1e-6)


def test_bytes_are_what_the_sdk_reads():
    joystick = pytest.importorskip(
        "unitree_sdk2py.utils.joystick", reason="needs unitree-sdk2py-dimos and pygame"
    ).Joystick()
    joystick.extract(write_remote(remote(Button.A | Button.L2, lx=0.5, ry=-0.25)))
    assert (joystick.A.pressed, joystick.LT.pressed, joystick.B.pressed) == (1, 1, 0)


def test_what_is_written_is_read():
    written = remote(Button.START | Button.LEFT, lx=0.5, ly=-0.25, rx=1.0, ry=-1.0)
    assert read_remote(write_remote(written)) == written


@pytest.mark.parametrize(("value", "stick"), [(np.nan, 0.0), (np.inf, 0.0), (7.0, 1.0)])
def test_sticks_are_within_their_way(value, stick):
    assert read_remote(write_remote(remote(ly=value))).ly == stick


def test_another_number_of_bytes_is_refused():
    with pytest.raises(ValueError, match="40 bytes"):
        read_remote(bytes(39))


@pytest.mark.parametrize(
    ("buttons", "asks"),
    [
        (Button.L2 | Button.B, True),
        (Button.L2 | Button.B | Button.A, True),
        (Button.L2, False),
        (Button.B, False),
        (Button.R2 | Button.B, False),
    ],
)
def test_two_buttons_together_damp(buttons, asks):
    assert remote(buttons).asks_to_damp is asks


def test_sticks_command_within_the_gaits_range(trot):
    settings = Sticks(dead_zone=0.1)

    def velocity(**sticks):
        return remote_command(remote(**sticks), trot, settings, 8.0).velocity.tolist()

    assert velocity() == [0.0, 0.0]
    assert velocity(ly=0.1, rx=-0.1) == [0.0, 0.0]
    assert velocity(ly=1.0) == [trot.max_speed, 0.0]
    assert velocity(ly=-1.0) == [-trot.max_speed, 0.0]
    # To the right is a negative turn.
    assert velocity(rx=1.0) == [0.0, -trot.max_yaw_rate]
    np.testing.assert_allclose(velocity(ly=0.55), [0.5 * trot.max_speed, 0.0])
    assert remote_command(remote(), trot, settings, 8.0).dwell == 8.0
