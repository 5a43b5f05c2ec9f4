"""What the operator of a robot on Unitree's wire asks for."""

import numpy as np
import pytest

from glassgait.models.link.operator import RemoteOperator
from glassgait.models.link.remote import REQUESTED_BY, Button, Remote, Sticks
from glassgait.models.task.day import REQUESTS, load_day
from glassgait.models.task.request import NO_MODE, RequestGate

FREE = Remote.untouched()


DAY = load_day()
STAND, RISE = DAY.names.index("stand"), DAY.names.index("rise")


def operator_of(trot, **settings):
    return RemoteOperator(trot, Sticks(), 8.0, gate=RequestGate(DAY), **settings)


def test_what_was_requested_last_is_asked_for_until_another_is(trot):
    operator = operator_of(trot)
    assert operator(FREE, STAND).requested_mode == REQUESTS.index("sit")
    for name in ("stand", "walk", "sit", "walk"):
        operator(FREE._replace(buttons=REQUESTED_BY[name]), STAND)
        assert operator(FREE, STAND).requested_mode == REQUESTS.index(name)


def test_of_two_buttons_the_calmer_request_counts(trot):
    operator = operator_of(trot)
    pressed = REQUESTED_BY["walk"] | REQUESTED_BY["sit"]
    asked = operator(FREE._replace(buttons=pressed), STAND)
    assert asked.requested_mode == REQUESTS.index("sit")
    pressed = REQUESTED_BY["walk"] | REQUESTED_BY["stand"] | Button.X
    asked = operator(FREE._replace(buttons=pressed), STAND)
    assert asked.requested_mode == REQUESTS.index("stand")


@pytest.mark.parametrize("mode", [NO_MODE, RISE])
def test_what_a_rising_robot_cannot_take_is_dropped_and_said_once(trot, mode, caplog):
    operator = operator_of(trot)
    operator(FREE._replace(buttons=REQUESTED_BY["stand"]), STAND)
    for _ in range(3):
        operator(FREE._replace(buttons=REQUESTED_BY["walk"], ly=1.0), mode)
    assert sum("is dropped" in record.message for record in caplog.records) == 1
    for _ in range(3):
        held = operator(FREE._replace(buttons=REQUESTED_BY["walk"]), STAND)
        assert held.requested_mode != REQUESTS.index("walk")
    assert operator(FREE, STAND).requested_mode != REQUESTS.index("walk")
    asked = operator(FREE._replace(buttons=REQUESTED_BY["walk"]), STAND)
    assert asked.requested_mode == REQUESTS.index("walk")


def test_shoulder_buttons_request_the_gait_beside_once_a_press(trot):
    operator = RemoteOperator(trot, Sticks(), 8.0, n_gaits=3, gait=1)
    found = [
        operator(FREE._replace(buttons=buttons), NO_MODE).requested_gait
        for buttons in (Button(0), Button.R1, Button.R1, Button(0), Button.R1, Button.L1)
    ]
    assert found == [1, 2, 2, 2, 0, 2]


def test_a_shoulder_button_that_is_held_before_the_robot_follows_changes_no_gait(trot):
    operator, pressed = operator_of(trot, n_gaits=3), FREE._replace(buttons=Button.R1)
    for mode in (NO_MODE, NO_MODE, STAND, STAND):
        assert operator(pressed, mode).requested_gait == 0
    operator(FREE, STAND)
    assert operator(pressed, STAND).requested_gait == 1


def test_a_button_that_is_held_acts_no_more_once_a_calmer_one_is_let_go(trot):
    operator, walk = operator_of(trot), REQUESTED_BY["walk"]
    found = [
        operator(FREE._replace(buttons=buttons), STAND).requested_mode
        for buttons in (walk, walk | REQUESTED_BY["stand"], walk, Button(0), walk)
    ]
    assert [REQUESTS[number] for number in found] == ["walk", "stand", "stand", "stand", "walk"]


def test_sticks_command(trot):
    asked = RemoteOperator(trot, Sticks(), 7.0)(FREE._replace(ly=1.0, rx=-1.0), NO_MODE)
    np.testing.assert_allclose(asked.command.velocity, [trot.max_speed, trot.max_yaw_rate])
    assert asked.command.dwell == 7.0
