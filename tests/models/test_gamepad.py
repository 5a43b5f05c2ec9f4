"""A gamepad in a browser, read as the robot's own remote."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.link.gamepad import read_gamepad, requested_gait
from glassgait.models.link.remote import DAMP, Button, Remote, Sticks, remote_command

NUMBERS = st.lists(st.floats(), max_size=20)


def test_sticks_are_read_forward_and_to_the_right():
    held = read_gamepad([0.1, -0.8, 0.5, 0.25], [])
    assert held == Remote(Button(0), lx=0.1, ly=0.8, rx=0.5, ry=-0.25)


def test_the_left_stick_goes_forward_and_the_right_one_turns(trot):
    command = remote_command(read_gamepad([0, -1, -1, 0], []), trot, Sticks(), 8.0)
    np.testing.assert_allclose(command.velocity, [trot.max_speed, trot.max_yaw_rate])
    resting = remote_command(read_gamepad([0.09, -0.09, 0.09, 0.0], []), trot, Sticks(), 8.0)
    np.testing.assert_array_equal(resting.velocity, 0.0)


@pytest.mark.parametrize(
    ("number", "button"),
    [(0, Button.A), (1, Button.B), (4, Button.L1), (6, Button.L2), (8, Button.SELECT)],
)
def test_buttons_are_those_of_the_standard_layout(number, button):
    pressed = np.zeros(17)
    pressed[number] = 1.0
    assert read_gamepad([], pressed).buttons == button
    pressed[number] = 0.4
    assert read_gamepad([], pressed).buttons == Button(0)


def test_both_buttons_that_damp_are_there():
    pressed = np.zeros(17)
    pressed[[1, 6]] = 1.0
    assert read_gamepad([], pressed).buttons == DAMP
    assert read_gamepad([], pressed).asks_to_damp


def test_nothing_is_held_where_nothing_is_reported():
    assert read_gamepad([], []) == Remote.untouched()


@given(axes=NUMBERS, buttons=NUMBERS)
def test_whatever_is_reported_sticks_are_finite_and_within_their_way(axes, buttons):
    held = read_gamepad(axes, buttons)
    assert all(-1.0 <= stick <= 1.0 for stick in held[1:])


@pytest.mark.parametrize(
    ("button", "running", "expected"),
    [(Button.R1, 0, 1), (Button.R1, 2, 0), (Button.L1, 0, 2), (Button.A, 1, 1)],
)
def test_a_button_requests_the_gait_beside_once(button, running, expected):
    free = Remote.untouched()
    pressed = free._replace(buttons=button)
    assert requested_gait(pressed, free, running, 3) == expected
    assert requested_gait(pressed, pressed, running, 3) == running
    assert requested_gait(free, pressed, running, 3) == running
