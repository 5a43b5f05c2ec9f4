"""Constants of the robot and its joint law."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped, robot


def test_joints_are_ordered_by_leg():
    assert quadruped.JOINTS[:4] == ("FL_hip", "FL_thigh", "FL_calf", "FR_hip")
    assert len(quadruped.JOINTS) == 12


def test_stance_is_inside_the_limits():
    assert np.all(robot.DEFAULT_STANCE > robot.LOWER_LIMITS)
    assert np.all(robot.DEFAULT_STANCE < robot.UPPER_LIMITS)


def test_zero_action_asks_for_the_stance():
    np.testing.assert_array_equal(robot.joint_targets(np.zeros(12)), robot.DEFAULT_STANCE)


def test_limited_targets_are_the_nearest_within_the_joints_ranges(generator):
    action = generator.normal(size=(50, 12), scale=8.0)
    asked = robot.joint_targets(action)
    followed = robot.joint_targets(action, limited=True)
    assert np.any(followed != asked)
    within = (asked >= robot.LOWER_LIMITS) & (asked <= robot.UPPER_LIMITS)
    np.testing.assert_array_equal(followed[within], asked[within])
    ends = np.where(asked < robot.LOWER_LIMITS, robot.LOWER_LIMITS, robot.UPPER_LIMITS)
    np.testing.assert_array_equal(followed[~within], ends[~within])
    assert np.all(np.isnan(robot.joint_targets(np.full(12, np.nan), limited=True)))


def test_torque_follows_the_pd_law_up_to_the_effort():
    zero = np.zeros(12)
    torque = robot.joint_torque(target=zero + 0.1, position=zero, velocity=zero + 2.0)
    np.testing.assert_allclose(torque, 1.0)
    torque = robot.joint_torque(target=zero + 5.0, position=zero, velocity=zero)
    np.testing.assert_allclose(torque, robot.EFFORT_LIMIT)


def test_joints_are_found_by_name_and_by_index():
    assert (
        quadruped.joint_index("FL_calf")
        == quadruped.joint_index(2)
        == quadruped.joint_index(np.int64(2))
    )
    for bad in ("FL_knee", "", 12, -1, 2.0, True, None, ["FL_hip"], np.zeros(2)):
        with pytest.raises(InputError, match="unknown joint"):
            quadruped.joint_index(bad)
