"""The joint targets."""

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff

from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.systems.joint_targets import JointTargets

A1 = load_robot()


def test_targets_follow_the_actuators_order(fix_inputs):
    reversed_joints = quadruped.JOINTS[::-1]
    system = JointTargets(A1, reversed_joints)
    action = np.arange(12.0)
    context = fix_inputs(system, action=action)
    desired = system.get_desired_state_output_port().Eval(context)
    np.testing.assert_allclose(desired[:12], (A1.default_stance + 0.25 * action)[::-1])
    np.testing.assert_array_equal(desired[12:], 0)


def test_targets_are_kept_within_the_joints_ranges(fix_inputs):
    system = JointTargets(A1, quadruped.JOINTS[::-1], limited=True)
    port = system.get_desired_state_output_port()
    desired = port.Eval(fix_inputs(system, action=np.full(12, 100.0)))
    np.testing.assert_array_equal(desired[:12], A1.upper_limits[::-1])
    desired = port.Eval(fix_inputs(system, action=np.full(12, -100.0)))
    np.testing.assert_array_equal(desired[:12], A1.lower_limits[::-1])


def test_kept_targets_convert_to_autodiff():
    system = JointTargets(A1, quadruped.JOINTS, limited=True).ToAutoDiffXd()
    context = system.CreateDefaultContext()
    # The first joint is within its range, the second at its end.
    action = InitializeAutoDiff(np.array([0.5, 50.0, *np.zeros(10)])).ravel()
    system.get_input_port().FixValue(context, action)
    slopes = ExtractGradient(system.get_output_port().Eval(context)[:12].reshape(-1, 1))
    assert slopes[0, 0] == A1.action_scale
    assert not slopes[1].any()


def test_clones_aim_by_their_own_action(fix_inputs):
    system = JointTargets(A1, quadruped.JOINTS)
    context = fix_inputs(system, action=np.zeros(12))
    clone = fix_inputs(system, context.Clone(), action=np.ones(12))
    port = system.get_desired_state_output_port()
    np.testing.assert_allclose(port.Eval(clone)[:12], A1.default_stance + 0.25)
    np.testing.assert_array_equal(port.Eval(context)[:12], A1.default_stance)


def test_refuses_other_joints():
    with pytest.raises(ValueError, match="joints"):
        JointTargets(A1, quadruped.JOINTS[:-1])
