"""Commands from sliders and from a gamepad."""

import numpy as np

from glassgait.systems.meshcat_command import (
    DWELL_SLIDER,
    SPEED_SLIDER,
    YAW_RATE_SLIDER,
    MeshcatCommand,
)

SLIDERS = (SPEED_SLIDER, YAW_RATE_SLIDER, DWELL_SLIDER)


def commanded(system, context):
    velocity = system.get_command_output_port().Eval(context)
    return [*velocity, *system.get_commanded_dwell_output_port().Eval(context)]


def move(meshcat, *values):
    for name, value in zip(SLIDERS, values, strict=True):
        meshcat.SetSliderValue(name, value)


def test_sliders_span_the_gaits_ranges(trot, meshcat):
    MeshcatCommand(trot, meshcat)
    for values, reached in (((9, 9, 99), (1, 1, 11)), ((-9, -9, 0), (-1, -1, 6))):
        move(meshcat, *values)
        assert tuple(meshcat.GetSliderValue(name) for name in SLIDERS) == reached


def test_sliders_are_read_at_the_next_control_instant(trot, latch, meshcat):
    system = MeshcatCommand(trot, meshcat)
    context = system.CreateDefaultContext()
    np.testing.assert_allclose(commanded(system, context), [0.5, 0.0, 8])
    move(meshcat, -0.25, 0.4, 7)
    np.testing.assert_allclose(commanded(system, context), [0.5, 0.0, 8])
    latch(system, context)
    np.testing.assert_allclose(commanded(system, context), [-0.25, 0.4, 7])


def test_clones_keep_what_they_read(trot, latch, meshcat):
    system = MeshcatCommand(trot, meshcat)
    context = system.CreateDefaultContext()
    clone = context.Clone()
    move(meshcat, -0.25, 0.4, 7)
    latch(system, context)
    np.testing.assert_allclose(commanded(system, clone), [0.5, 0.0, 8])


def test_server_listens_on_localhost_alone(server):
    assert server.web_url().startswith("http://localhost:")


def test_a_gamepad_that_is_there_commands_in_place_of_sliders(trot, latch, meshcat, browsers):
    system = MeshcatCommand(trot, browsers)
    context = system.CreateDefaultContext()
    latch(system, context)
    np.testing.assert_allclose(commanded(system, context), [0.5, 0.0, 8])
    move(meshcat, -0.25, 0.4, 7)
    browsers.hold(0.0, -1.0, -0.55, 0.0)
    latch(system, context)
    np.testing.assert_allclose(commanded(system, context), [1.0, 0.5, 7])
    browsers.hold(0.0, 0.05, 0.05, 0.0)
    latch(system, context)
    np.testing.assert_array_equal(commanded(system, context), [0.0, 0.0, 7])


def test_a_gamepad_that_reports_nonsense_commands_within_the_range(trot, latch, meshcat, browsers):
    system = MeshcatCommand(trot, browsers)
    context = system.CreateDefaultContext()
    browsers.hold(np.nan, np.nan, np.inf)
    latch(system, context)
    np.testing.assert_array_equal(commanded(system, context), [0.0, 0.0, 8])
    browsers.hold(0.0, -1e9, -1e9, 0.0)
    latch(system, context)
    np.testing.assert_allclose(commanded(system, context), [1.0, 1.0, 8])


def test_a_gamepad_whose_browser_is_gone_commands_nothing(trot, latch, browsers):
    system = MeshcatCommand(trot, browsers)
    context = system.CreateDefaultContext()
    browsers.hold(0.0, -1.0, -0.55, 0.0)
    latch(system, context)
    np.testing.assert_allclose(commanded(system, context)[:2], [1.0, 0.5])
    browsers.n_browsers = 0
    latch(system, context)
    np.testing.assert_array_equal(commanded(system, context)[:2], [0.0, 0.0])
