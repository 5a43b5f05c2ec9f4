"""Limits between a policy and the joints."""

from types import SimpleNamespace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.systems.target_limits import TargetLimitsSystem

A1 = load_robot()
LIMITS = JointLaw((40.0, 1.0)).with_limits(A1).limits
REACH = 33.5 / 40.0 / A1.action_scale
IMU = np.concatenate([np.zeros(6), [0.0, 0.0, -1.0]])
JOINTS = np.concatenate([A1.default_stance, np.full(12, 3.0)])


def test_it_limits_what_it_is_given_and_remembers_nothing(fix_inputs):
    system = TargetLimitsSystem(A1, LIMITS)
    limited = system.get_limited_action_output_port()
    given = {"action": np.full(12, 0.5), "previous_action": np.zeros(12)}
    context = fix_inputs(system, **given, joints=JOINTS, imu=IMU)
    np.testing.assert_array_equal(limited.Eval(context), given["action"])
    clone = context.Clone()
    # A front thigh has room to go forward by more than the reach.
    fix_inputs(system, context, action=np.full(12, 9.0))
    assert limited.Eval(context)[1] == pytest.approx(REACH)
    np.testing.assert_array_equal(limited.Eval(clone), given["action"])
    fix_inputs(system, context, action=np.full(12, np.nan))
    np.testing.assert_array_equal(limited.Eval(context), given["previous_action"])
    fix_inputs(system, context, action=np.full(12, 0.5), imu=np.zeros(9))
    np.testing.assert_array_equal(limited.Eval(context), np.zeros(12))
    assert not context.num_total_states()


def test_a_robot_that_starts_beyond_its_limits_is_refused():
    robot = SimpleNamespace(
        name="narrow",
        action_scale=0.25,
        default_stance=A1.default_stance,
        lower_limits=A1.default_stance,
        upper_limits=A1.upper_limits,
    )
    with pytest.raises(InputError, match="margin"):
        TargetLimitsSystem(robot, LIMITS)
