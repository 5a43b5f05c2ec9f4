"""Commands from sliders."""

import numpy as np
import pytest

from glassgait.diagrams.visualization import open_meshcat
from glassgait.systems.meshcat_command import (
    DWELL_SLIDER,
    SPEED_SLIDER,
    YAW_RATE_SLIDER,
    MeshcatCommand,
)

SLIDERS = (SPEED_SLIDER, YAW_RATE_SLIDER, DWELL_SLIDER)


@pytest.fixture(scope="module")
def server():
    return open_meshcat()


@pytest.fixture
def meshcat(server):
    yield server
    server.DeleteAddedControls()


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
