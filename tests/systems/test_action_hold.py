"""The action hold."""

import numpy as np
from pydrake.systems.analysis import Simulator

from glassgait.systems.action_hold import ActionHold


def held(system, context):
    return (
        system.get_held_action_output_port().Eval(context)[0],
        system.get_previous_action_output_port().Eval(context)[0],
    )


def test_holds_the_latest_and_the_one_before(fix_inputs):
    system = ActionHold()
    context = fix_inputs(system, action=np.full(12, 1.0))
    assert held(system, context) == (0, 0)
    simulator = Simulator(system, context)
    simulator.Initialize()
    simulator.AdvanceTo(0.01)
    assert held(system, context) == (1, 0)
    fix_inputs(system, context, action=np.full(12, 2.0))
    simulator.AdvanceTo(0.02)
    assert held(system, context) == (1, 0)
    simulator.AdvanceTo(0.03)
    assert held(system, context) == (2, 1)


def test_clones_hold_their_own(fix_inputs, latch):
    system = ActionHold()
    context = fix_inputs(system, action=np.ones(12))
    clone = context.Clone()
    latch(system, context)
    assert held(system, context)[0] == 1
    assert held(system, clone)[0] == 0
