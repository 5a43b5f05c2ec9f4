"""The parts of the controller, and the joints that follow it."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.models.estimation.sensors import UNCHANGED_STEPS
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.systems.action import ActionHold, JointTargets
from glassgait.systems.observation import ContactTrustSystem, RewardMachineSystem

A1 = load_robot()
HEIGHT = [0.0, 0.05, 0.0, 0.05]
FL_RR = {"foot_contact": np.array([1.0, 0, 0, 1]), "foot_height": np.array([0.0, 0.04, 0.04, 0])}


def test_stuck_sensors_give_way_to_heights_until_they_change(fix_inputs, latch):
    system = ContactTrustSystem()
    contact, touching = (
        system.GetOutputPort(name) for name in ("believed_contact", "believed_touching")
    )
    seen = {"touching": [1, 1, 0, 0], "foot_height": HEIGHT}
    context = fix_inputs(system, **seen)
    for _ in range(UNCHANGED_STEPS):
        np.testing.assert_array_equal(contact.Eval(context), seen["touching"])
        np.testing.assert_array_equal(touching.Eval(context), seen["touching"])
        latch(system, context)
    believed = [1, 0, 1, 0]
    np.testing.assert_array_equal(contact.Eval(context), believed)
    np.testing.assert_array_equal(touching.Eval(context), believed)
    clone = context.Clone()
    fix_inputs(system, context, touching=[1, 0, 1, 1])
    np.testing.assert_array_equal(touching.Eval(context), [1, 0, 1, 1])
    # A clone has its memory.
    latch(system, context)
    np.testing.assert_array_equal(touching.Eval(clone), believed)


def test_the_reward_machine_shows_this_instants_propositions(trot, fix_inputs, latch):
    system = RewardMachineSystem(trot)
    names = ("rm_state", "rm_iterations", "reward_multiplier", "served_dwell")
    ports = [system.GetOutputPort(name) for name in names]
    context = fix_inputs(system, **FL_RR, commanded_dwell=1)
    clone = context.Clone()
    assert [port.Eval(context).tolist() for port in ports] == [[0, 1], [0], [1000], [1]]
    fix_inputs(system, context, commanded_dwell=2)
    assert [port.Eval(context).tolist() for port in ports] == [[1, 0], [1], [1], [0]]
    latch(system, context)
    assert [port.Eval(context).tolist() for port in ports] == [[0, 1], [0], [1000], [2]]
    assert ports[0].Eval(clone).tolist() == [0, 1]
    first, *others = trot.transitions
    half = RewardMachineSystem(replace(trot, transitions=(replace(first, dwell=0.5), *others)))
    context = fix_inputs(half, **FL_RR, commanded_dwell=2)
    assert half.GetOutputPort("served_dwell").Eval(context) == [1.0]


def test_actions_are_held_from_the_control_instant_on(fix_inputs):
    system = ActionHold()
    context = fix_inputs(system, action=np.full(12, 1.0), asked_action=np.zeros(12))
    ports = [
        system.GetOutputPort(name) for name in ("held_action", "previous_action", "delayed_action")
    ]
    simulator = Simulator(system, context)
    simulator.Initialize()
    assert [port.Eval(context)[0] for port in ports] == [0, 0, 0]
    simulator.AdvanceTo(0.01)
    assert [port.Eval(context)[0] for port in ports] == [1, 0, 1]
    fix_inputs(system, context, action=np.full(12, 2.0))
    simulator.AdvanceTo(0.02)
    assert [port.Eval(context)[0] for port in ports] == [1, 0, 1]
    simulator.AdvanceTo(0.03)
    assert [port.Eval(context)[0] for port in ports] == [2, 1, 2]


@pytest.mark.parametrize(
    ("latency", "time_step"),
    [
        *((0.01, 0.01), (0.01, 0.0025), (0.0075, 0.0025)),
        *((0.02, 0.01), (0.03, 0.01), (0.0325, 0.0025), (0.04, 0.01)),
    ],
)
def test_actions_reach_the_joints_late_in_every_period(latency, time_step, fix_inputs):
    system = ActionHold(latency, time_step)
    context = fix_inputs(system, action=np.zeros(12), asked_action=np.zeros(12))
    port = system.GetOutputPort("delayed_action")
    simulator = Simulator(system, context)
    simulator.Initialize()
    for period in range(60):
        # The action of a period is latched as it begins.
        fix_inputs(system, context, action=np.full(12, period + 1.0))
        for share in (0.03, 0.2, 0.45, 0.7, 0.97):
            time = 0.02 * (period + share)
            simulator.AdvanceTo(time)
            assert port.Eval(context)[0] == max(np.floor((time - latency) / 0.02) + 1, 0)


def test_targets_follow_the_actuators_order_within_the_joints_ranges(fix_inputs):
    names, action = list(quadruped.JOINTS[::-1]), np.arange(12.0)
    system = JointTargets(A1, names)
    desired = system.get_output_port().Eval(fix_inputs(system, action=action))
    np.testing.assert_allclose(desired[:12], (A1.default_stance + 0.25 * action)[::-1])
    np.testing.assert_array_equal(desired[12:], 0)
    limited = JointTargets(A1, names, limited=True)
    for value, ends in ((100.0, A1.upper_limits), (-100.0, A1.lower_limits)):
        desired = limited.get_output_port().Eval(fix_inputs(limited, action=np.full(12, value)))
        np.testing.assert_array_equal(desired[:12], ends[::-1])
