"""An operator who steers in Meshcat a robot that another process moves."""

from types import SimpleNamespace

import numpy as np
import pytest

from glassgait.diagrams.meshcat_operator import MeshcatOperator
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.link.gamepad import BUTTONS
from glassgait.models.link.remote import DAMP, Button, Remote
from glassgait.models.task.day import REQUESTS
from glassgait.systems.meshcat_command import DWELL_SLIDER, SPEED_SLIDER, YAW_RATE_SLIDER

TOUCHED = Remote(Button.START, 1.0, 1.0, 1.0, 1.0)


@pytest.fixture(scope="module")
def meshcat():
    return open_meshcat()


class Browsers:
    """A Meshcat that browsers show, one of them with a gamepad."""

    def __init__(self, meshcat):
        self.meshcat, self.n_browsers = meshcat, 1
        self.gamepad = SimpleNamespace(index=None, axes=[], button_values=[])

    def hold(self, *axes, buttons=Button(0)):  # noqa: B008
        values = [float(own in buttons) for own in BUTTONS]
        self.gamepad = SimpleNamespace(index=0, axes=list(axes), button_values=values)

    def GetGamepad(self):  # noqa: N802
        return self.gamepad

    def GetNumActiveConnections(self):  # noqa: N802
        return self.n_browsers

    def __getattr__(self, name):
        return getattr(self.meshcat, name)


@pytest.fixture
def steered(meshcat):
    yield Browsers(meshcat)
    meshcat.DeleteAddedControls()


def click(meshcat, name):
    words = ("type", "button", "name", name)
    packed = b"".join(bytes([0xA0 | len(word)]) + word.encode() for word in words)
    meshcat._InjectWebsocketMessage(message=b"\x82" + packed)


def test_asks_for_what_sliders_and_buttons_say_and_not_the_remote(trot, steered):
    operator = MeshcatOperator(trot, steered, requests=True)
    asked = operator(TOUCHED)
    np.testing.assert_array_equal(asked.command.velocity, 0.0)
    assert asked.requested_mode == REQUESTS.index("sit")
    steered.SetSliderValue(SPEED_SLIDER, -0.25)
    steered.SetSliderValue(DWELL_SLIDER, 7)
    click(steered, "walk")
    operator(TOUCHED)
    asked = operator(TOUCHED)
    np.testing.assert_allclose([*asked.command.velocity, asked.command.dwell], [-0.25, 0.0, 7])
    assert asked.requested_mode == REQUESTS.index("walk")


def test_has_no_buttons_without_a_day(trot, steered):
    operator = MeshcatOperator(trot, steered, requests=False)
    assert steered.GetButtonNames() == []
    assert operator(TOUCHED).requested_mode == 0


@pytest.mark.parametrize("requests", [False, True])
def test_the_robot_steps_on_the_spot_at_first(trot, steered, requests):
    operator = MeshcatOperator(trot, steered, requests=requests)
    assert steered.GetSliderValue(SPEED_SLIDER) == 0.0
    for _ in range(3):
        np.testing.assert_array_equal(operator(TOUCHED).command.velocity, 0.0)


@pytest.mark.parametrize("by_gamepad", [False, True])
def test_the_robot_stops_once_no_browser_is_there_and_waits_for_what_a_new_one_does(
    trot, steered, by_gamepad
):
    operator = MeshcatOperator(trot, steered, requests=False)
    steered.SetSliderValue(SPEED_SLIDER, 0.75)
    steered.SetSliderValue(YAW_RATE_SLIDER, 0.25)
    if by_gamepad:
        steered.hold(0.0, -0.775, -0.325, 0.0)
    np.testing.assert_allclose(operator(TOUCHED).command.velocity, [0.75, 0.25])
    steered.n_browsers = 0
    np.testing.assert_array_equal(operator(TOUCHED).command.velocity, 0.0)
    steered.n_browsers = 1
    np.testing.assert_array_equal(operator(TOUCHED).command.velocity, 0.0)


def test_l2_and_b_of_a_gamepad_ask_to_damp(trot, steered):
    operator = MeshcatOperator(trot, steered, requests=False)
    for buttons, damped in ((Button.B, False), (DAMP, True), (Button.L2, False)):
        steered.hold(0.0, 0.0, 0.0, 0.0, buttons=buttons)
        assert operator(Remote.untouched()).damped is damped
