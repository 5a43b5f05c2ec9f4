"""An operator who steers in Meshcat a robot that another process moves."""

import numpy as np
import pytest

from glassgait.diagrams.meshcat_operator import MeshcatOperator
from glassgait.models.link.remote import DAMP, Button, Remote
from glassgait.models.task.day import REQUESTS
from glassgait.systems.meshcat_command import DWELL_SLIDER, SPEED_SLIDER, YAW_RATE_SLIDER

TOUCHED = Remote(Button.START, 1.0, 1.0, 1.0, 1.0)


def test_asks_for_what_sliders_and_buttons_say_and_not_the_remote(trot, browsers, click):
    operator = MeshcatOperator(trot, browsers, requests=True)
    asked = operator(TOUCHED)
    np.testing.assert_array_equal(asked.command.velocity, 0.0)
    assert asked.requested_mode == REQUESTS.index("sit")
    browsers.SetSliderValue(SPEED_SLIDER, -0.25)
    browsers.SetSliderValue(DWELL_SLIDER, 7)
    click("walk")
    operator(TOUCHED)
    asked = operator(TOUCHED)
    np.testing.assert_allclose([*asked.command.velocity, asked.command.dwell], [-0.25, 0.0, 7])
    assert asked.requested_mode == REQUESTS.index("walk")


def test_has_no_buttons_without_a_day(trot, browsers):
    operator = MeshcatOperator(trot, browsers, requests=False)
    assert browsers.GetButtonNames() == []
    assert operator(TOUCHED).requested_mode == 0


@pytest.mark.parametrize("requests", [False, True])
def test_the_robot_steps_on_the_spot_at_first(trot, browsers, requests):
    operator = MeshcatOperator(trot, browsers, requests=requests)
    assert browsers.GetSliderValue(SPEED_SLIDER) == 0.0
    for _ in range(3):
        np.testing.assert_array_equal(operator(TOUCHED).command.velocity, 0.0)


@pytest.mark.parametrize("by_gamepad", [False, True])
def test_the_robot_stops_once_no_browser_is_there_and_waits_for_what_a_new_one_does(
    trot, browsers, by_gamepad
):
    operator = MeshcatOperator(trot, browsers, requests=False)
    browsers.SetSliderValue(SPEED_SLIDER, 0.75)
    browsers.SetSliderValue(YAW_RATE_SLIDER, 0.25)
    if by_gamepad:
        browsers.hold(0.0, -0.775, -0.325, 0.0)
    np.testing.assert_allclose(operator(TOUCHED).command.velocity, [0.75, 0.25])
    browsers.n_browsers = 0
    np.testing.assert_array_equal(operator(TOUCHED).command.velocity, 0.0)
    browsers.n_browsers = 1
    np.testing.assert_array_equal(operator(TOUCHED).command.velocity, 0.0)


def test_l2_and_b_of_a_gamepad_ask_to_damp(trot, browsers):
    operator = MeshcatOperator(trot, browsers, requests=False)
    for buttons, damped in ((Button.B, False), (DAMP, True), (Button.L2, False)):
        browsers.hold(0.0, 0.0, 0.0, 0.0, buttons=buttons)
        assert operator(Remote.untouched()).damped is damped
