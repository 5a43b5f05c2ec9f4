"""Sources of commands."""

import numpy as np
import pytest

from diagrams.visualization import open_meshcat
from systems.command import RandomCommand
from systems.meshcat_command import DWELL_SLIDER, SPEED_SLIDER, YAW_RATE_SLIDER, MeshcatCommand


def command_at(system, time, seed=None):
    context = system.CreateDefaultContext()
    if seed is not None:
        system.set_seed(context, seed)
    context.SetTime(time)
    return (
        system.get_command_output_port().Eval(context).tolist(),
        system.get_commanded_dwell_output_port().Eval(context)[0],
    )


def test_random_command_ports(trot, port_sizes):
    assert port_sizes(RandomCommand(trot, 0)) == ({}, {"command": 2, "commanded_dwell": 1})


def test_random_command_changes_every_ten_seconds(trot):
    system = RandomCommand(trot, 0)
    assert command_at(system, 0.0) == command_at(system, 9.98)
    assert command_at(system, 10.0) != command_at(system, 9.98)
    assert command_at(system, 10.0) == command_at(system, 19.98)


def test_random_command_is_a_function_of_its_seed(trot):
    assert command_at(RandomCommand(trot, 1), 0.0) == command_at(RandomCommand(trot, 1), 0.0)
    assert command_at(RandomCommand(trot, 1), 0.0) != command_at(RandomCommand(trot, 2), 0.0)
    assert command_at(RandomCommand(trot, 1), 0.0, seed=2) == command_at(
        RandomCommand(trot, 2), 0.0
    )


def test_speed_range_narrows_the_draw(trot):
    system = RandomCommand(trot, 3, speed_range=(0.5, 0.6))
    speeds = [command_at(system, 10.0 * i)[0][0] for i in range(20)]
    assert min(speeds) >= 0.5
    assert max(speeds) <= 0.6


@pytest.fixture(scope="module")
def meshcat():
    return open_meshcat()


def test_sliders_are_read_at_the_next_control_instant(trot, port_sizes, latch, meshcat):
    system = MeshcatCommand(trot, meshcat)
    assert port_sizes(system) == ({}, {"command": 2, "commanded_dwell": 1})
    context = system.CreateDefaultContext()
    np.testing.assert_allclose(system.get_command_output_port().Eval(context), [0.5, 0.0])
    for name, value in ((SPEED_SLIDER, -0.25), (YAW_RATE_SLIDER, 0.4), (DWELL_SLIDER, 7)):
        meshcat.SetSliderValue(name, value)
    np.testing.assert_allclose(system.get_command_output_port().Eval(context), [0.5, 0.0])
    latch(system, context)
    np.testing.assert_allclose(system.get_command_output_port().Eval(context), [-0.25, 0.4])
    np.testing.assert_allclose(system.get_commanded_dwell_output_port().Eval(context), [7])


def test_server_listens_on_localhost_alone(meshcat):
    assert meshcat.web_url().startswith("http://localhost:")
