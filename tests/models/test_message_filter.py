"""Which messages over Unitree's wire are believed."""

import numpy as np
import pytest

from glassgait.models.link.dds import Heard
from glassgait.models.link.message_filter import CommandFilter, StateFilter
from glassgait.models.link.motors import MotorCommand, damping, pack_low_cmd
from glassgait.models.link.unitree_messages import LOW_STATE, seal
from glassgait.models.robots.library import load_robot

GO2 = load_robot("go2")


def state(tick, **imu):
    message = LOW_STATE.blank()
    message["tick"] = tick
    message["imu_state"]["quaternion"] = 1.0, 0.0, 0.0, 0.0
    for name, value in imu.items():
        message["imu_state"][name] = value
    return seal(message)


def believed(states, *ticks, publisher=1):
    return [states.believed(Heard(state(tick), publisher)) is not None for tick in ticks]


def test_states_are_believed_in_order_and_losses_counted():
    states = StateFilter()
    assert all(believed(states, 100, 102, 104, 110, 112))
    assert (states.counts.heard, states.counts.lost) == (5, 2)


def test_what_came_before_or_leaps_is_not_believed():
    states = StateFilter()
    assert believed(states, 100, 100, 98, 0, 2**32 - 1, 1101, 102) == [
        True,
        False,
        False,
        False,
        False,
        False,
        True,
    ]
    assert (states.counts.old, states.counts.lost) == (5, 0)


def test_another_publisher_is_not_believed_whatever_it_says():
    states = StateFilter()
    believed(states, 100)
    assert believed(states, 102, 104, publisher=2) == [False, False]
    corrupt = state(102)
    corrupt["tick"] = 103
    for _ in range(50):
        states.believed(Heard(corrupt, 2))
    assert states.bad == 0
    assert believed(states, 102) == [True]
    assert states.counts.others == 52


def test_bad_states_in_a_row_are_counted():
    states = StateFilter()
    believed(states, 100)
    corrupt = state(102)
    corrupt["crc"] += 1
    for message in (corrupt, state(104, gyroscope=np.nan), corrupt):
        assert states.believed(Heard(message, 1)) is None
    assert (states.bad, states.counts.corrupt, states.counts.useless) == (3, 2, 1)
    assert believed(states, 108) == [True]
    assert states.bad == 0


def test_bytes_that_are_no_state_are_counted():
    states = StateFilter()
    assert states.believed(Heard(None, 1)) is None
    assert states.counts.foreign == 1


def command(**changes):
    sent = MotorCommand.to(GO2.default_stance, (40.0, 1.0))
    message = pack_low_cmd(GO2, sent)
    for name, value in changes.items():
        message["motor_cmd"][name][3] = value
    return seal(message)


@pytest.mark.parametrize(
    "changes",
    [{"q": np.nan}, {"q": 9.0}, {"kp": 1e6}, {"kd": np.inf}, {"tau": 1e30}, {"mode": 0}],
)
def test_commands_that_joints_may_not_be_given_are_dropped(changes):
    commands = CommandFilter(GO2)
    assert commands.believed(Heard(command(**changes), 1)) is None
    assert commands.counts.useless == 1


def test_commands_of_a_second_publisher_are_dropped_while_the_first_is_heard():
    commands = CommandFilter(GO2)
    assert commands.believed(Heard(command(), 1)) is not None
    assert commands.believed(Heard(command(), 2)) is None
    assert commands.counts.others == 1
    commands.release()
    assert commands.believed(Heard(command(), 2)) is not None
    wrong = pack_low_cmd(GO2, damping(GO2.default_stance, 5.0))
    wrong["crc"] += 1
    assert commands.believed(Heard(wrong, 2)) is None
    assert commands.counts.corrupt == 1
