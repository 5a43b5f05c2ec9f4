"""Commands: fixed, drawn, or from sliders, and which are refused."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import MonteCarloSimulation, Simulator

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError

CALM = Scenario(command=FixedCommand(), sensor_noise=0.0, true_body_state=True)
DRAWN = replace(CALM, command=DrawnCommands())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"speed": 1.5}, "speed is 1.5; give -1 to 1, the range of gait 'trot'"),
        ({"dwell": 5}, "dwell is 5; give 6 to 11"),
        ({"dwell": 8.5}, "dwell is 8.5; it must be a valid integer"),
    ],
)
def test_commands_that_the_gait_is_not_made_for_are_refused(trot, values, message):
    with pytest.raises(InputError, match=f"command: {message}"):
        MakeLocomotion(trot, replace(CALM, command=FixedCommand(**values)))


def test_sliders_need_a_meshcat(trot):
    with pytest.raises(InputError, match="need a Meshcat"):
        MakeLocomotion(trot, replace(CALM, command=SliderCommand()))


def start_of(diagram, context):
    ports = ("command", "commanded_dwell", "state")
    return np.concatenate([diagram.GetOutputPort(port).Eval(context) for port in ports])


def test_monte_carlo_draws_command_and_pose_for_every_simulation(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))

    def drawn(seed):
        starts = []

        def output(system, context):
            starts.append(start_of(system, context))
            return 0.0

        MonteCarloSimulation(
            make_simulator=lambda generator: Simulator(diagram),
            output=output,
            final_time=0.0,
            num_samples=6,
            generator=RandomGenerator(seed),
        )
        return np.array(starts)

    first = drawn(1)
    np.testing.assert_array_equal(first, drawn(1))
    assert not np.array_equal(first, drawn(2))
    yaw_rate, first_joint, last_joint = 1, 3 + 7, 3 + 18
    for column in (yaw_rate, first_joint, last_joint):
        assert len(set(first[:, column])) == 6
    assert len(set(first[:, 2])) > 1


def test_commands_change_with_time_but_not_with_the_updates(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))
    simulator = make_simulator(diagram, seed=3)
    commands = record(simulator, 510, stop_on_failure=False)["command"]
    assert len(np.unique(commands[:500], axis=0)) == 1
    assert len(np.unique(commands[500:], axis=0)) == 1
    assert np.all(commands[499] != commands[500])
