"""Commands: drawn, from sliders, and from a planner."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.systems.commands import (
    DWELL_SLIDER,
    SPEED_SLIDER,
    YAW_RATE_SLIDER,
    GivenCommand,
    MeshcatCommand,
    RandomCommand,
)

SLIDERS = (SPEED_SLIDER, YAW_RATE_SLIDER, DWELL_SLIDER)


def commanded(system, context):
    ports = [system.GetOutputPort(name) for name in ("command", "commanded_dwell")]
    return np.concatenate([port.Eval(context) for port in ports]).tolist()


def drawn_at(system, time, seed=0.5):
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, [seed])
    context.SetTime(time)
    return commanded(system, context)


def test_drawn_commands_change_every_ten_seconds(trot):
    system = RandomCommand(trot)
    assert drawn_at(system, 0.0) == drawn_at(system, 9.98)
    assert drawn_at(system, 10.0) != drawn_at(system, 9.98)
    assert drawn_at(system, 10.0) == drawn_at(system, 19.98)


def move(meshcat, *values):
    for name, value in zip(SLIDERS, values, strict=True):
        meshcat.SetSliderValue(name, value)


def test_sliders_are_read_at_the_next_control_instant(trot, latch, meshcat):
    system = MeshcatCommand(trot, meshcat)
    context = system.CreateDefaultContext()
    clone = context.Clone()
    assert commanded(system, context) == [0.5, 0.0, 8]
    move(meshcat, -0.25, 0.4, 7)
    assert commanded(system, context) == [0.5, 0.0, 8]
    latch(system, context)
    np.testing.assert_allclose(commanded(system, context), [-0.25, 0.4, 7])
    assert commanded(system, clone) == [0.5, 0.0, 8]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, [0.3, -0.2, 7.0]),
        ({"command": [0.5, 0.1]}, [0.5, 0.1, 7.0]),
        ({"commanded_dwell": 9.0}, [0.3, -0.2, 9.0]),
        ({"command": [3.0, -7.0], "commanded_dwell": 100.0}, [1.0, -1.0, 11.0]),
        ({"command": [np.nan, 0.0]}, r"input port 'command': is given .*nan"),
        ({"commanded_dwell": np.inf}, "input port 'commanded_dwell': is given"),
    ],
)
def test_a_planner_commands_within_the_gaits_ranges(trot, fix_inputs, given, expected):
    system = GivenCommand(trot)
    context = fix_inputs(system, drawn_command=[0.3, -0.2], drawn_dwell=7.0, **given)
    if isinstance(expected, str):
        with pytest.raises(InputError, match=expected):
            commanded(system, context)
    else:
        assert commanded(system, context) == expected


def test_drawn_commands_stay_in_their_ranges(trot):
    drawn = np.array([drawn_at(RandomCommand(trot), 0.0, float(seed)) for seed in range(200)])
    assert 0.8 < np.abs(drawn[:, :2]).max() <= 1.0
    assert set(drawn[:, 2]) == set(range(trot.dwell[0], trot.dwell[1] + 1))
    narrow = RandomCommand(trot, speed_range=(0.5, 0.6))
    speeds = [drawn_at(narrow, 10.0 * i)[0] for i in range(20)]
    assert min(speeds) >= 0.5 and max(speeds) <= 0.6
