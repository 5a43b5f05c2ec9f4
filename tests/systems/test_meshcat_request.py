"""Requests of gaits, and of a day's modes, from buttons and from a gamepad."""

from glassgait.diagrams.gait_machine import gait_buttons, mode_buttons
from glassgait.models.link.remote import REQUESTED_BY, Button
from glassgait.models.task.day import REQUESTS, load_day
from glassgait.models.task.gait import load_gait
from glassgait.models.task.request import NO_MODE, RequestGate

GAITS = [load_gait(name) for name in ("walk", "trot", "half_bound")]
NAMES = [gait.name for gait in GAITS]

DAY = load_day()
GATE, STAND, RISE = RequestGate(DAY), DAY.names.index("stand"), DAY.names.index("rise")


def requested(system, context):
    return system.get_requested_output_port().Eval(context).tolist()


def test_every_gait_has_a_button(meshcat):
    gait_buttons(NAMES, meshcat)
    for name in ("walk *", "trot", "half-bound"):
        assert meshcat.GetButtonClicks(name) == 0


def test_the_requested_gait_alone_is_marked(meshcat, latch, click):
    system = gait_buttons(NAMES, meshcat)
    context = system.CreateDefaultContext()
    # Meshcat gives the names sorted: in which order they show, a browser says.
    for gait, labels in (
        (GAITS[2], {"walk", "trot", "half-bound *"}),
        (GAITS[1], {"walk", "trot *", "half-bound"}),
        (GAITS[1], {"walk", "trot *", "half-bound"}),
    ):
        click(gait.name)
        latch(system, context)
        assert set(meshcat.GetButtonNames()) == labels
    latch(system, system.CreateDefaultContext())
    assert set(meshcat.GetButtonNames()) == {"walk *", "trot", "half-bound"}


def test_the_gait_of_the_button_is_requested_from_the_next_control_instant_on(
    meshcat, latch, click
):
    system = gait_buttons(NAMES, meshcat)
    context = system.CreateDefaultContext()
    assert requested(system, context) == [0]
    for gait, number in ((GAITS[2], 2), (GAITS[1], 1), (GAITS[0], 0)):
        before = requested(system, context)
        click(gait.name)
        assert requested(system, context) == before
        latch(system, context)
        assert requested(system, context) == [number]
        latch(system, context)
        assert requested(system, context) == [number]


def test_clones_keep_what_was_requested_and_a_new_context_begins_with_the_first(
    meshcat, latch, click
):
    system = gait_buttons(NAMES, meshcat)
    context = system.CreateDefaultContext()
    clone = context.Clone()
    click(GAITS[1].name)
    latch(system, context)
    fresh = system.CreateDefaultContext()
    for other in (clone, fresh):
        latch(system, other)
        assert requested(system, other) == [0]
    assert requested(system, context) == [1]


def test_a_gamepad_goes_to_the_gait_beside_once_a_press(meshcat, browsers, latch):
    system = gait_buttons(NAMES, browsers)
    context = system.CreateDefaultContext()
    for button, number in (
        (Button.R1, 1),
        (Button.R1, 1),
        (Button(0), 1),
        (Button.L1, 0),
        (Button(0), 0),
        (Button.L1, 2),
    ):
        browsers.hold(buttons=button)
        latch(system, context)
        assert requested(system, context) == [number]
    assert set(meshcat.GetButtonNames()) == {"walk", "trot", "half-bound *"}


def test_modes_of_a_day_are_requested_by_buttons_and_by_a_gamepad(
    meshcat, browsers, latch, click, fix_inputs
):
    system = mode_buttons(GATE, browsers)
    context = fix_inputs(system, mode=STAND)
    assert set(meshcat.GetButtonNames()) == {"sit *", "stand", "walk"}
    click("walk")
    latch(system, context)
    assert requested(system, context) == [REQUESTS.index("walk")]
    for name in ("stand", "sit", "walk"):
        browsers.hold(buttons=REQUESTED_BY[name])
        latch(system, context)
        browsers.hold(buttons=Button(0))
        latch(system, context)
        assert requested(system, context) == [REQUESTS.index(name)]
    assert set(meshcat.GetButtonNames()) == {"sit", "stand", "walk *"}


def test_a_button_of_a_gamepad_whose_browser_is_gone_requests_nothing(
    meshcat, browsers, latch, click, fix_inputs
):
    system = mode_buttons(GATE, browsers)
    context = fix_inputs(system, mode=STAND)
    browsers.hold(buttons=REQUESTED_BY["walk"])
    latch(system, context)
    browsers.n_browsers = 0
    click("sit")
    latch(system, context)
    assert requested(system, context) == [REQUESTS.index("sit")]


def test_what_the_mode_cannot_take_is_dropped_and_said_once_in_each_context(
    meshcat, latch, click, fix_inputs, caplog
):
    system = mode_buttons(GATE, meshcat)
    context = fix_inputs(system, mode=STAND)
    click("stand")
    latch(system, context)
    fix_inputs(system, context, mode=RISE)
    click("walk")
    for _ in range(3):
        latch(system, context)
        assert requested(system, context) == [REQUESTS.index("stand")]
    assert [record.message for record in caplog.records] == [
        "the request to walk is dropped: the robot is in the mode 'rise', which does not take it; "
        "give it again later"
    ]
    clone = context.Clone()
    fix_inputs(system, clone, mode=NO_MODE)
    latch(system, clone)
    assert requested(system, clone) == [REQUESTS.index("sit")]
    assert requested(system, context) == [REQUESTS.index("stand")]
    fix_inputs(system, context, mode=STAND)
    click("walk")
    latch(system, context)
    assert requested(system, context) == [REQUESTS.index("walk")]
