"""The reward machine as a Mealy system."""

from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import Simulator

from glassgait.systems.reward_machine import RewardMachineSystem

FL_RR = np.array([1.0, 0, 0, 1])
HEIGHT = np.array([0.0, 0.04, 0.04, 0])


def outputs(system, context):
    ports = (
        system.get_rm_state_output_port(),
        system.get_rm_iterations_output_port(),
        system.get_reward_multiplier_output_port(),
        system.get_served_dwell_output_port(),
    )
    return [port.Eval(context).tolist() for port in ports]


def test_outputs_are_those_after_this_instants_propositions(trot, fix_inputs):
    system = RewardMachineSystem(trot)
    context = fix_inputs(system, foot_contact=FL_RR, foot_height=HEIGHT, commanded_dwell=1)
    assert outputs(system, context) == [[0, 1], [0], [1000], [1]]
    fix_inputs(system, context, commanded_dwell=2)
    assert outputs(system, context) == [[1, 0], [1], [1], [0]]


def test_state_follows_in_the_update(trot, fix_inputs):
    system = RewardMachineSystem(trot)
    context = fix_inputs(system, foot_contact=FL_RR, foot_height=HEIGHT, commanded_dwell=6)
    simulator = Simulator(system, context)
    simulator.Initialize()
    assert context.get_discrete_state_vector().value().tolist() == [0, 0, 0]
    for step in range(1, 8):
        simulator.AdvanceTo(step * 0.02)
        expected = [[0, step, step], [1, step - 6, step]][step > 5]
        assert context.get_discrete_state_vector().value().tolist() == expected


def test_clones_keep_their_own_state(trot, fix_inputs, latch):
    system = RewardMachineSystem(trot)
    context = fix_inputs(system, foot_contact=FL_RR, foot_height=HEIGHT, commanded_dwell=1)
    clone = context.Clone()
    latch(system, context)
    assert context.get_discrete_state_vector().value()[0] == 1
    assert clone.get_discrete_state_vector().value()[0] == 0


def test_serves_the_share_of_the_edge_that_fires(trot, fix_inputs):
    first, *others = trot.transitions
    shares = (replace(first, dwell=0.5), *others)
    system = RewardMachineSystem(replace(trot, transitions=shares))
    context = fix_inputs(system, foot_contact=FL_RR, foot_height=HEIGHT, commanded_dwell=2)
    assert system.get_served_dwell_output_port().Eval(context) == [1.0]
    fix_inputs(system, context, foot_contact=1 - FL_RR, foot_height=0.04 - HEIGHT)
    assert system.get_served_dwell_output_port().Eval(context) == [0.0]
