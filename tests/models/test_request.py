"""Which requests a robot's day takes, and which it drops."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.task.day import REQUESTS, load_day
from glassgait.models.task.request import NO_MODE, SIT, RequestGate

DAY = load_day()
GATE = RequestGate(DAY)
NUMBERS = st.integers(0, len(REQUESTS) - 1)


def number(name):
    return REQUESTS.index(name)


def takes(mode, before, asked, gate=GATE):
    return gate.takes(DAY.names.index(mode), number(before), number(asked))


@pytest.mark.parametrize("mode", ["fold", "rise", "sit", "damped"])
def test_a_robot_that_does_not_stand_does_not_take_that_it_is_to_walk(mode):
    assert not takes(mode, "stand", "walk")
    assert takes(mode, "stand", "sit")
    assert takes(mode, "sit", "stand")


@pytest.mark.parametrize("mode", ["stand", "walk"])
def test_a_robot_that_stands_or_walks_takes_every_request(mode):
    for before in REQUESTS:
        for asked in REQUESTS:
            assert before == asked or takes(mode, before, asked)


def test_a_robot_that_rests_takes_what_lets_it_rise():
    assert takes("rest", "sit", "stand")
    assert takes("rest", "sit", "walk")
    assert not takes("rest", "stand", "walk")


@given(before=NUMBERS, asked=NUMBERS)
def test_nothing_is_taken_without_a_mode_and_all_by_a_day_that_is_not_known(before, asked):
    assert GATE.settled(NO_MODE, before, asked) == SIT
    assert RequestGate(None).settled(3, before, asked) == asked
    assert GATE.settled(len(DAY.modes), before, asked) == asked


def test_a_request_that_is_dropped_is_logged_and_does_not_act_later(caplog):
    rise, stand = (DAY.names.index(name) for name in ("rise", "stand"))
    own = GATE.settled(rise, number("stand"), number("walk"))
    assert own == number("stand")
    assert [record.message for record in caplog.records] == [
        "the request to walk is dropped: the robot is in the mode 'rise', which does not take it; "
        "give it again later"
    ]
    for mode in (rise, stand):
        own = GATE.settled(mode, own, own)
        assert own == number("stand")
    assert len(caplog.records) == 1
    assert GATE.settled(stand, own, number("walk")) == number("walk")


def test_a_request_that_ends_as_the_link_is_lost_is_logged_once(caplog):
    own = number("walk")
    for _ in range(3):
        own = GATE.settled(NO_MODE, own, own)
    assert own == SIT
    assert [record.message for record in caplog.records] == [
        "the request to walk ends, and the robot is to sit: it no longer follows a controller with "
        "a day; give it again later"
    ]
    assert GATE.settled(DAY.names.index("walk"), own, own) == SIT
