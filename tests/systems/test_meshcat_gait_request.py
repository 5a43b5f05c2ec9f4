"""Requests of gaits from buttons."""

import pytest

from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.task.gait import load_gait
from glassgait.systems.meshcat_gait_request import MeshcatGaitRequest, gait_button

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


def click(meshcat, *gaits):
    """Does what a browser does when a person clicks, on whichever label the gait's button has."""
    shown = meshcat.GetButtonNames()
    for gait in gaits:
        label = next(own for own in shown if own in (gait_button(gait), gait_button(gait, True)))
        message = packed("type", "button", "name", label)
        meshcat._InjectWebsocketMessage(message=message)


def requested(system, context):
    return system.get_requested_gait_output_port().Eval(context).tolist()


def test_every_gait_has_a_button(meshcat):
    MeshcatGaitRequest(GAITS, meshcat)
    for name in ("walk *", "trot", "half-bound"):
        assert meshcat.GetButtonClicks(name) == 0


def test_the_requested_gait_alone_is_marked(meshcat, latch):
    system = MeshcatGaitRequest(GAITS, meshcat)
    context = system.CreateDefaultContext()
    # Meshcat gives the names sorted: in which order they show, a browser says.
    for gait, labels in (
        (GAITS[2], {"walk", "trot", "half-bound *"}),
        (GAITS[1], {"walk", "trot *", "half-bound"}),
        (GAITS[1], {"walk", "trot *", "half-bound"}),
    ):
        click(meshcat, gait)
        latch(system, context)
        assert set(meshcat.GetButtonNames()) == labels
    latch(system, system.CreateDefaultContext())
    assert set(meshcat.GetButtonNames()) == {"walk *", "trot", "half-bound"}


def test_the_gait_of_the_button_is_requested_from_the_next_control_instant_on(meshcat, latch):
    system = MeshcatGaitRequest(GAITS, meshcat)
    context = system.CreateDefaultContext()
    assert requested(system, context) == [0]
    for gait, number in ((GAITS[2], 2), (GAITS[1], 1), (GAITS[0], 0)):
        before = requested(system, context)
        click(meshcat, gait)
        assert requested(system, context) == before
        latch(system, context)
        assert requested(system, context) == [number]
        latch(system, context)
        assert requested(system, context) == [number]


def test_clones_keep_what_was_requested_and_a_new_context_begins_with_the_first(meshcat, latch):
    system = MeshcatGaitRequest(GAITS, meshcat)
    context = system.CreateDefaultContext()
    clone = context.Clone()
    click(meshcat, GAITS[1])
    latch(system, context)
    fresh = system.CreateDefaultContext()
    for other in (clone, fresh):
        latch(system, other)
        assert requested(system, other) == [0]
    assert requested(system, context) == [1]
