"""An operator who steers in Meshcat a robot that another process moves."""

import numpy as np
import pytest

from glassgait.diagrams.meshcat_operator import MeshcatOperator
from glassgait.models.link.remote import DAMP, Button, Remote
from glassgait.models.task.day import REQUESTS, load_day
from glassgait.models.task.request import NO_MODE, RequestGate
from glassgait.systems.meshcat_command import DWELL_SLIDER, SPEED_SLIDER, YAW_RATE_SLIDER

DAY = load_day()
GATE, STAND, RISE = RequestGate(DAY), DAY.names.index("stand"), DAY.names.index("rise")
TOUCHED = Remote(Button.START, 1.0, 1.0, 1.0, 1.0)


def test_asks_for_what_sliders_and_buttons_say_and_not_the_remote(trot, browsers, click):
    operator = MeshcatOperator(trot, browsers, gate=GATE)
    asked = operator(TOUCHED, STAND)
    np.testing.assert_array_equal(asked.command.velocity, 0.0)
    assert asked.requested_mode == REQUESTS.index("sit")
    browsers.SetSliderValue(SPEED_SLIDER, -0.25)
    browsers.SetSliderValue(DWELL_SLIDER, 7)
    click("walk")
    operator(TOUCHED, STAND)
    asked = operator(TOUCHED, STAND)
    np.testing.assert_allclose([*asked.command.velocity, asked.command.dwell], [-0.25, 0.0, 7])
    assert asked.requested_mode == REQUESTS.index("walk")


def test_has_no_buttons_without_a_day(trot, browsers):
    operator = MeshcatOperator(trot, browsers)
    assert browsers.GetButtonNames() == []
    assert operator(TOUCHED, STAND).requested_mode == 0


@pytest.mark.parametrize("gate", [None, GATE])
def test_the_robot_steps_on_the_spot_at_first(trot, browsers, gate):
    operator = MeshcatOperator(trot, browsers, gate=gate)
    assert browsers.GetSliderValue(SPEED_SLIDER) == 0.0
    for _ in range(3):
        np.testing.assert_array_equal(operator(TOUCHED, STAND).command.velocity, 0.0)


@pytest.mark.parametrize("by_gamepad", [False, True])
def test_the_robot_stops_once_no_browser_is_there_and_waits_for_what_a_new_one_does(
    trot, browsers, by_gamepad
):
    operator = MeshcatOperator(trot, browsers)
    browsers.SetSliderValue(SPEED_SLIDER, 0.75)
    browsers.SetSliderValue(YAW_RATE_SLIDER, 0.25)
    if by_gamepad:
        browsers.hold(0.0, -0.775, -0.325, 0.0)
    np.testing.assert_allclose(operator(TOUCHED, STAND).command.velocity, [0.75, 0.25])
    browsers.n_browsers = 0
    np.testing.assert_array_equal(operator(TOUCHED, STAND).command.velocity, 0.0)
    browsers.n_browsers = 1
    np.testing.assert_array_equal(operator(TOUCHED, STAND).command.velocity, 0.0)


def test_l2_and_b_of_a_gamepad_ask_to_damp(trot, browsers):
    operator = MeshcatOperator(trot, browsers)
    for buttons, damped in ((Button.B, False), (DAMP, True), (Button.L2, False)):
        browsers.hold(0.0, 0.0, 0.0, 0.0, buttons=buttons)
        assert operator(Remote.untouched(), STAND).damped is damped


@pytest.mark.parametrize("mode", [NO_MODE, RISE])
@pytest.mark.parametrize("by_gamepad", [False, True])
def test_walking_is_not_requested_for_later_of_a_robot_that_rises(
    trot, browsers, click, mode, by_gamepad, caplog
):
    operator = MeshcatOperator(trot, browsers, gate=GATE)
    click("stand")
    for _ in range(3):
        operator(TOUCHED, STAND)
    if by_gamepad:
        browsers.hold(buttons=Button.START)
    else:
        click("walk")
    for _ in range(3):
        operator(TOUCHED, mode)
    browsers.hold()
    for _ in range(3):
        asked = operator(TOUCHED, STAND)
    holds = "sit" if mode == NO_MODE else "stand"
    assert asked.requested_mode == REQUESTS.index(holds)
    # Of a robot that no longer follows, what held is said to end, too.
    assert len(caplog.records) == (2 if mode == NO_MODE else 1)
    assert "walk *" not in browsers.GetButtonNames()
    click("walk")
    for _ in range(2):
        asked = operator(TOUCHED, STAND)
    assert asked.requested_mode == REQUESTS.index("walk")


def test_gaits_have_buttons_where_there_are_several(trot, browsers, click):
    operator = MeshcatOperator(trot, browsers, gaits=("walk", "trot", "bound"), gait=1)
    assert operator(TOUCHED, NO_MODE).requested_gait == 1
    click("bound")
    for _ in range(2):
        asked = operator(TOUCHED, NO_MODE)
    assert asked.requested_gait == 2
    assert "bound *" in browsers.GetButtonNames()
