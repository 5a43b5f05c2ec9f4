"""Commands drawn at random."""

import numpy as np
import pytest

from glassgait.systems.command import RandomCommand


def command_at(system, time, seed=0.5):
    context = system.CreateDefaultContext()
    system.get_seed_input_port().FixValue(context, [seed])
    context.SetTime(time)
    return (
        system.get_command_output_port().Eval(context).tolist(),
        system.get_commanded_dwell_output_port().Eval(context)[0],
    )


def test_changes_every_ten_seconds(trot):
    system = RandomCommand(trot)
    assert command_at(system, 0.0) == command_at(system, 9.98)
    assert command_at(system, 10.0) != command_at(system, 9.98)
    assert command_at(system, 10.0) == command_at(system, 19.98)


def test_is_a_function_of_any_number_as_seed(trot):
    seeds = [0.0, 1.0, -1.0, 0.25, 0.25 + 1e-16, 1e300]
    first, again = ([command_at(RandomCommand(trot), 0.0, seed) for seed in seeds] for _ in "ab")
    assert first == again
    assert len({str(command) for command in first}) == len(set(seeds))


def test_stays_in_the_gaits_ranges(trot):
    system = RandomCommand(trot)
    drawn = [command_at(system, 0.0, float(seed)) for seed in range(200)]
    velocities = np.array([velocity for velocity, _ in drawn])
    assert 0.8 < np.abs(velocities).max() <= 1.0
    assert {dwell for _, dwell in drawn} == set(range(trot.dwell[0], trot.dwell[1] + 1))


def test_speed_range_narrows_the_draw(trot):
    system = RandomCommand(trot, speed_range=(0.5, 0.6))
    speeds = [command_at(system, 10.0 * i)[0][0] for i in range(20)]
    assert min(speeds) >= 0.5
    assert max(speeds) <= 0.6


def test_clones_draw_by_their_own_seed_and_time(trot):
    system = RandomCommand(trot)
    context = system.CreateDefaultContext()
    system.get_seed_input_port().FixValue(context, [1.0])
    clone = context.Clone()
    clone.SetTime(10.0)
    port = system.get_command_output_port()
    assert port.Eval(clone).tolist() == command_at(system, 10.0, 1.0)[0]
    assert port.Eval(context).tolist() == command_at(system, 0.0, 1.0)[0]


@pytest.mark.parametrize("speeds", [(0.6, 0.5), (float("nan"), 0.5)])
def test_refuses_a_reversed_range(trot, speeds):
    with pytest.raises(ValueError, match="give the least first"):
        RandomCommand(trot, speed_range=speeds)
