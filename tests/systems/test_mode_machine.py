"""The machine of a robot's day between a policy and the limits of its targets."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.models.errors import InputError
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import REQUESTS, load_day
from glassgait.systems.mode_machine import ModeMachineSystem

A1, DAY = load_robot(), load_day()
RESTING = DAY.steps("rest")
IMU = np.concatenate([np.zeros(8), [-1.0]])
JOINTS = np.concatenate([A1.default_stance, np.zeros(12)])
GIVEN = {
    "action": np.full(12, 0.5),
    "previous_action": np.full(12, 0.1),
    "joints": JOINTS,
    "imu": IMU,
    "command": [0.4, 0.2],
}


def mode_of(system, context):
    return DAY.names[int(system.get_mode_output_port().Eval(context)[0])]


def latched(system, context, n_steps):
    """Takes so many control steps since the start, the first at time 0."""
    simulator = Simulator(system, context)
    simulator.AdvanceTo((n_steps - 0.5) * CONTROL_PERIOD)


def test_it_rests_until_it_is_requested_to_rise(fix_inputs):
    system = ModeMachineSystem(A1, DAY)
    context = fix_inputs(system, **GIVEN)
    assert mode_of(system, context) == "rest"
    np.testing.assert_allclose(system.get_asked_action_output_port().Eval(context), 0.0)
    assert system.get_damped_output_port().Eval(context)[0] == 1.0
    assert system.get_acts_output_port().Eval(context)[0] == 0.0
    np.testing.assert_array_equal(system.get_served_command_output_port().Eval(context), 0.0)
    fix_inputs(system, context, requested_mode=[REQUESTS.index("walk")])
    assert mode_of(system, context) == "rest"
    fix_inputs(system, context, requested_mode=[REQUESTS.index("sit")])
    latched(system, context, RESTING)
    clone = context.Clone()
    fix_inputs(system, context, requested_mode=[REQUESTS.index("walk")])
    assert mode_of(system, context) == "fold"
    np.testing.assert_array_equal(
        system.get_asked_action_output_port().Eval(context), GIVEN["previous_action"]
    )
    np.testing.assert_array_equal(
        system.get_served_command_output_port().Eval(context), GIVEN["command"]
    )
    assert mode_of(system, clone) == "rest"


def test_it_lets_the_policy_act_once_the_robot_stands(fix_inputs):
    system = ModeMachineSystem(A1, DAY)
    context = fix_inputs(system, **GIVEN, requested_mode=[REQUESTS.index("walk")])
    acted = system.get_acted_output_port()
    latched(system, context, RESTING + 51 + 76 + 16)
    assert mode_of(system, context) == "walk"
    assert acted.Eval(context)[0] == 0.0
    np.testing.assert_array_equal(
        system.get_asked_action_output_port().Eval(context), GIVEN["action"]
    )
    latched(system, context, RESTING + 51 + 76 + 16 + 1)
    assert acted.Eval(context)[0] == 1.0
    tipped = IMU.copy()
    tipped[6:9] = [0.0, 0.9, -0.3]
    fix_inputs(system, context, imu=tipped)
    assert mode_of(system, context) == "damped"
    assert system.get_damped_output_port().Eval(context)[0] == 1.0


def test_bad_requests_and_postures_are_refused(fix_inputs):
    system = ModeMachineSystem(A1, DAY)
    context = fix_inputs(system, **GIVEN, requested_mode=[7])
    with pytest.raises(ValueError, match="from 0 to 2"):
        system.get_mode_output_port().Eval(context)
    folded = DAY.postures["folded"]
    wrong = type(folded)(front=(2.0, 1.4, -2.65), rear=folded.rear)
    day = replace(DAY, postures={"folded": wrong})
    with pytest.raises(InputError, match="FL_hip"):
        ModeMachineSystem(A1, day)
