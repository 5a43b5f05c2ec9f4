"""Limits of targets: their guarantees, for any action and any sensor readings."""

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw

ROBOTS = {name: load_robot(name) for name in ("a1", "go2")}
LEVEL = np.array([0.0, 0.0, -1.0])
ANYTHING = arrays.arrays(float, 12, elements=st.floats(width=64))
SHARES = arrays.arrays(float, 12, elements=st.floats(0.0, 1.0))
GRAVITY = arrays.arrays(float, 3, elements=st.floats(-1.5, 1.5) | st.just(np.nan))
ROUNDING = 1e-12


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]


def limits_of(robot):
    limits = JointLaw().with_limits(robot).limits
    assert limits is not None
    return limits


def within(robot, limits, share):
    """Returns actions (12) between the ends."""
    least, greatest = limits.ends(robot)
    return least + share * (greatest - least)


@given(action=ANYTHING, share=SHARES, position=ANYTHING, gravity=GRAVITY)
def test_targets_stay_in_their_ranges_and_near_to_those_before(action, share, position, gravity):
    for robot in ROBOTS.values():
        limits = limits_of(robot)
        before = within(robot, limits, share)
        with np.errstate(over="ignore", invalid="ignore"):
            left = limits.applied(robot, action, before=before, position=position, gravity=gravity)
        targets, last = robot.joint_targets(left), robot.joint_targets(before)
        assert np.all(targets >= robot.lower_limits + limits.margin - ROUNDING)
        assert np.all(targets <= robot.upper_limits - limits.margin + ROUNDING)
        assert np.all(np.abs(targets - last) <= robot.effort / limits.stiffness + ROUNDING)
        if not np.isfinite([action, position]).all():
            np.testing.assert_array_equal(left, before)


@given(actions=st.lists(ANYTHING, min_size=1, max_size=5), shares=st.lists(SHARES, min_size=5))
def test_motors_are_asked_for_no_more_torque_than_they_have(actions, shares):
    """The readings of joints change by at most the reach per step."""
    for robot in ROBOTS.values():
        limits = limits_of(robot)
        reach = robot.effort / limits.stiffness
        before, position = np.zeros(12), robot.default_stance
        for action, share in zip(actions, shares, strict=False):
            low = robot.lower_limits + limits.margin
            high = robot.upper_limits - limits.margin
            position = np.clip(position + (2.0 * share - 1.0) * reach, low, high)
            asked = np.where(np.isfinite(action), action, 0.0)
            before = limits.applied(robot, asked, before=before, position=position, gravity=LEVEL)
            torque = limits.stiffness * (robot.joint_targets(before) - position)
            assert np.all(np.abs(torque) <= robot.effort + 1e-9)


def test_actions_that_no_limit_touches_are_kept_to_the_last_digit(robot, generator):
    limits = limits_of(robot)
    action = generator.uniform(-0.3, 0.3, size=(50, 12))
    position = robot.default_stance + generator.uniform(-0.1, 0.1, size=(50, 12))
    before = np.zeros((50, 12))
    left = limits.applied(robot, action, before=before, position=position, gravity=LEVEL)
    np.testing.assert_array_equal(left, action)


@pytest.mark.parametrize(
    ("lean", "acts"), [(0.0, True), (59.0, True), (61.0, False), (120, False), (np.nan, False)]
)
def test_a_leaning_trunk_has_its_joints_sent_to_where_they_are(lean, acts, robot):
    limits = limits_of(robot)
    angle = np.radians(lean)
    gravity = np.array([np.sin(angle), 0.0, -np.cos(angle)])
    position = robot.default_stance + 0.1
    left = limits.applied(
        robot, np.full(12, -0.2), before=np.zeros(12), position=position, gravity=gravity
    )
    wanted = -0.2 * robot.action_scale if acts else 0.1
    np.testing.assert_allclose(robot.joint_targets(left) - robot.default_stance, wanted)


def test_a_stance_at_the_end_of_a_range_is_refused(robot):
    class Narrow:
        name, action_scale = robot.name, robot.action_scale
        default_stance = lower_limits = robot.default_stance
        upper_limits = robot.upper_limits

    with pytest.raises(InputError, match="margin"):
        limits_of(robot).check(Narrow())
