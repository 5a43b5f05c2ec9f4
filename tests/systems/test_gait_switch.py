"""The machine of several gaits as a Mealy system."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.models.task.gait import load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.systems.gait_switch import GaitSwitchSystem

FL_RR = np.array([1.0, 0, 0, 1])
HEIGHT = np.array([0.0, 0.04, 0.04, 0])
TROT, WALK = 0, 1


@pytest.fixture
def system(trot):
    return GaitSwitchSystem(GaitSwitch([trot, load_gait("walk")]))


@pytest.fixture
def trotting(system, fix_inputs):
    """A trot that stands on FL and RR at each instant, with a dwell of 6 steps."""
    return fix_inputs(system, foot_contact=FL_RR, foot_height=HEIGHT, commanded_dwell=6)


def stored(context):
    return context.get_discrete_state_vector().value().tolist()


def state_of(system, context):
    return int(system.get_rm_state_output_port().Eval(context).argmax())


def test_the_gait_changes_at_the_instant_at_which_the_machine_moves_on(
    system, trotting, fix_inputs
):
    fix_inputs(system, trotting, requested_gait=WALK)
    simulator = Simulator(system, trotting)
    simulator.Initialize()
    for step in range(1, 6):
        simulator.AdvanceTo(step * 0.02)
        assert stored(trotting) == [0, step, step]
    # The sixth instant's outputs show the change, and its update follows.
    assert state_of(system, trotting) == 2
    assert system.get_rm_iterations_output_port().Eval(trotting) == [0]
    assert system.get_served_dwell_output_port().Eval(trotting) == [6]
    assert system.get_reward_multiplier_output_port().Eval(trotting) == [1000]
    simulator.AdvanceTo(0.12)
    assert stored(trotting) == [2, 0, 0]


def test_without_a_request_the_gait_goes_on(system, trotting, fix_inputs):
    trotting.SetDiscreteState([0, 5, 40])
    assert state_of(system, trotting) == 1
    fix_inputs(system, trotting, requested_gait=WALK)
    assert state_of(system, trotting) == 2
    fix_inputs(system, trotting, requested_gait=TROT)
    assert state_of(system, trotting) == 1


def test_clones_keep_their_own_state(system, trotting, latch):
    trotting.SetDiscreteState([0, 5, 40])
    clone = trotting.Clone()
    latch(system, trotting)
    assert stored(trotting) == [1, 0, 41]
    assert stored(clone) == [0, 5, 40]


def test_refuses_a_gait_that_there_is_not(system, trotting, fix_inputs):
    fix_inputs(system, trotting, requested_gait=2)
    with pytest.raises(ValueError, match="requested"):
        state_of(system, trotting)
