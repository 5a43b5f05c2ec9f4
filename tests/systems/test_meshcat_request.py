"""Requests of gaits, and of a day's modes, from buttons and from a gamepad."""

from types import SimpleNamespace

import pytest

from glassgait.diagrams.gait_machine import gait_buttons, mode_buttons
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.link.gamepad import BUTTONS
from glassgait.models.link.remote import REQUESTED_BY, Button
from glassgait.models.task.day import REQUESTS
from glassgait.models.task.gait import load_gait
from glassgait.systems.meshcat_request import request_button

GAITS = [load_gait(name) for name in ("walk", "trot", "half_bound")]


@pytest.fixture(scope="module")
def server():
    return open_meshcat()


@pytest.fixture
def meshcat(server):
    yield server
    server.DeleteAddedControls()


def packed(*words):
    """Packs a mapping of two short texts to two others as MessagePack does."""
    return b"\x82" + b"".join(bytes([0xA0 | len(word)]) + word.encode() for word in words)


def click(meshcat, *names):
    """Does what a browser does when a person clicks, on whichever label the button has."""
    shown = meshcat.GetButtonNames()
    for name in names:
        label = next(
            own for own in shown if own in (request_button(name), request_button(name, True))
        )
        message = packed("type", "button", "name", label)
        meshcat._InjectWebsocketMessage(message=message)


def requested(system, context):
    return system.get_requested_output_port().Eval(context).tolist()


def test_every_gait_has_a_button(meshcat):
    gait_buttons(GAITS, meshcat)
    for name in ("walk *", "trot", "half-bound"):
        assert meshcat.GetButtonClicks(name) == 0


def test_the_requested_gait_alone_is_marked(meshcat, latch):
    system = gait_buttons(GAITS, meshcat)
    context = system.CreateDefaultContext()
    # Meshcat gives the names sorted: in which order they show, a browser says.
    for gait, labels in (
        (GAITS[2], {"walk", "trot", "half-bound *"}),
        (GAITS[1], {"walk", "trot *", "half-bound"}),
        (GAITS[1], {"walk", "trot *", "half-bound"}),
    ):
        click(meshcat, gait.name)
        latch(system, context)
        assert set(meshcat.GetButtonNames()) == labels
    latch(system, system.CreateDefaultContext())
    assert set(meshcat.GetButtonNames()) == {"walk *", "trot", "half-bound"}


def test_the_gait_of_the_button_is_requested_from_the_next_control_instant_on(meshcat, latch):
    system = gait_buttons(GAITS, meshcat)
    context = system.CreateDefaultContext()
    assert requested(system, context) == [0]
    for gait, number in ((GAITS[2], 2), (GAITS[1], 1), (GAITS[0], 0)):
        before = requested(system, context)
        click(meshcat, gait.name)
        assert requested(system, context) == before
        latch(system, context)
        assert requested(system, context) == [number]
        latch(system, context)
        assert requested(system, context) == [number]


def test_clones_keep_what_was_requested_and_a_new_context_begins_with_the_first(meshcat, latch):
    system = gait_buttons(GAITS, meshcat)
    context = system.CreateDefaultContext()
    clone = context.Clone()
    click(meshcat, GAITS[1].name)
    latch(system, context)
    fresh = system.CreateDefaultContext()
    for other in (clone, fresh):
        latch(system, other)
        assert requested(system, other) == [0]
    assert requested(system, context) == [1]


class Held:
    """A Meshcat whose browser reports a gamepad with a button that is held."""

    def __init__(self, meshcat):
        self.meshcat, self.button, self.n_browsers = meshcat, Button(0), 1

    def GetGamepad(self):  # noqa: N802
        values = [float(own in self.button) for own in BUTTONS]
        return SimpleNamespace(index=0, axes=[], button_values=values)

    def GetNumActiveConnections(self):  # noqa: N802
        return self.n_browsers

    def __getattr__(self, name):
        return getattr(self.meshcat, name)


def test_a_gamepad_goes_to_the_gait_beside_once_a_press(meshcat, latch):
    held = Held(meshcat)
    system = gait_buttons(GAITS, held)
    context = system.CreateDefaultContext()
    for button, number in (
        (Button.R1, 1),
        (Button.R1, 1),
        (Button(0), 1),
        (Button.L1, 0),
        (Button(0), 0),
        (Button.L1, 2),
    ):
        held.button = button
        latch(system, context)
        assert requested(system, context) == [number]
    assert set(meshcat.GetButtonNames()) == {"walk", "trot", "half-bound *"}


def test_modes_of_a_day_are_requested_by_buttons_and_by_a_gamepad(meshcat, latch):
    held = Held(meshcat)
    system = mode_buttons(held)
    context = system.CreateDefaultContext()
    assert set(meshcat.GetButtonNames()) == {"sit *", "stand", "walk"}
    click(meshcat, "walk")
    latch(system, context)
    assert requested(system, context) == [REQUESTS.index("walk")]
    for name in ("stand", "sit", "walk"):
        held.button = REQUESTED_BY[name]
        latch(system, context)
        held.button = Button(0)
        latch(system, context)
        assert requested(system, context) == [REQUESTS.index(name)]
    assert set(meshcat.GetButtonNames()) == {"sit", "stand", "walk *"}


def test_a_button_of_a_gamepad_whose_browser_is_gone_requests_nothing(meshcat, latch):
    held = Held(meshcat)
    system = mode_buttons(held)
    context = system.CreateDefaultContext()
    held.button = REQUESTED_BY["walk"]
    latch(system, context)
    held.n_browsers = 0
    click(meshcat, "sit")
    latch(system, context)
    assert requested(system, context) == [REQUESTS.index("sit")]
