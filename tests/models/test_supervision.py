"""A robot without a watchdog of its own: it rises, follows, and is damped for good."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.models.link.motors import may_be_given
from glassgait.models.link.self_test import N_STEPS, self_test_targets
from glassgait.models.link.supervision import (
    Fault,
    Stage,
    Supervision,
    commanded,
    initial_course,
    step_course,
)
from glassgait.models.link.watchdog import CROUCH
from glassgait.models.robots.library import load_robot

GO2 = load_robot("go2")
SETTINGS = Supervision()
GAINS = (40.0, 1.0)
TARGETS = GO2.default_stance + 0.05


def stepped(course, now, settings=SETTINGS, *, lean=0.0, asked=False, position=CROUCH):
    return step_course(course, settings, now, position=position, lean=lean, asked=asked)


def command_at(course, now):
    command = commanded(GO2, course, SETTINGS, now, targets=TARGETS, gains=GAINS)
    assert may_be_given(GO2, command)
    return command


def test_rises_from_where_it_lies_and_then_follows():
    course = stepped(initial_course(GO2), 7.0)
    assert course.stage is Stage.RISING
    np.testing.assert_array_equal(command_at(course, 7.0).q, CROUCH)
    poses = np.array([command_at(course, 7.0 + t).q for t in np.arange(0.0, 3.01, 0.002)])
    # It goes without a leap, and slowly: a joint needs half a second for half a radian at least.
    assert np.abs(np.diff(poses, axis=0)).max() < 0.002
    np.testing.assert_allclose(poses[-1], GO2.default_stance, atol=1e-6)
    course = stepped(course, 9.99)
    assert course.stage is Stage.RISING
    course = stepped(course, 10.0, replace(SETTINGS, self_test=False))
    assert course.stage is Stage.FOLLOWING
    np.testing.assert_array_equal(command_at(course, 10.0).q, TARGETS)
    assert set(command_at(course, 10.0).kp) == {40.0}


def test_moves_each_joint_before_it_follows():
    risen = stepped(stepped(initial_course(GO2), 7.0), 10.0)
    assert risen.stage is Stage.TESTING
    moves = np.array([command_at(risen, 10.0 + 0.02 * step).q for step in range(N_STEPS)])
    np.testing.assert_array_equal(moves, self_test_targets(GO2))
    np.testing.assert_array_equal(command_at(risen, 60.0).q, GO2.default_stance)
    assert stepped(risen, 60.0).stage is Stage.TESTING
    passed = risen.passed(12.1)
    assert (passed.stage, passed.since) == (Stage.FOLLOWING, 12.1)
    assert risen.damped(Fault.MISWIRED, 12.1).stage is Stage.DAMPED


def test_a_posture_beyond_the_ranges_is_left_from_their_ends():
    course = stepped(initial_course(GO2), 0.0, position=GO2.upper_limits + 0.01)
    np.testing.assert_array_equal(command_at(course, 0.0).q, GO2.upper_limits)


@pytest.mark.parametrize("now", [0.0, 1.0, 5.0])
@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ({"lean": 46.0}, Fault.LEANS),
        ({"lean": np.nan}, Fault.LEANS),
        ({"asked": True}, Fault.ASKED),
    ],
)
def test_is_damped_in_every_stage_and_stays_so(now, wrong, fault):
    course = initial_course(GO2)
    for instant in np.arange(0.0, now, 0.5):
        course = stepped(course, instant)
    course = stepped(course, now, **wrong)
    assert (course.stage, course.fault) == (Stage.DAMPED, fault)
    for instant in np.arange(now, now + 20.0, 0.5):
        course = stepped(course, instant)
    assert (course.stage, course.fault) == (Stage.DAMPED, fault)
    command = command_at(course, now)
    assert command.is_damping
    assert set(command.kd) == {SETTINGS.damping}
    assert not command.tau.any()


def test_the_first_reason_is_kept():
    course = stepped(stepped(initial_course(GO2), 0.0), 1.0, lean=90.0)
    assert course.damped(Fault.SILENT, 2.0) == course


LYING = {"position": CROUCH, "lean": 0.0, "asked": False, "lies": True}
"""What is known of a robot whose controller has a day."""


def test_a_day_is_followed_at_once_where_nothing_is_tested():
    plain = replace(SETTINGS, self_test=False)
    assert step_course(initial_course(GO2), plain, 7.0, **LYING).stage is Stage.FOLLOWING


def test_a_day_begins_after_the_test_with_a_robot_that_was_lowered():
    course = step_course(initial_course(GO2), SETTINGS, 7.0, **LYING)
    assert course.stage is Stage.RISING
    course = step_course(course, SETTINGS, 10.0, **LYING).passed(12.0, lies=True)
    assert course.stage is Stage.LOWERING
    poses = np.array([command_at(course, 12.0 + t).q for t in np.arange(0.0, 3.01, 0.002)])
    np.testing.assert_allclose(poses[0], GO2.default_stance, atol=1e-9)
    np.testing.assert_allclose(poses[-1], CROUCH, atol=1e-9)
    assert np.abs(np.diff(poses, axis=0)).max() < 0.002
    assert step_course(course, SETTINGS, 14.9, **LYING).stage is Stage.LOWERING
    assert step_course(course, SETTINGS, 15.0, **LYING).stage is Stage.FOLLOWING


def test_what_a_day_damps_is_what_supervision_damps():
    followed = initial_course(GO2)._replace(stage=Stage.FOLLOWING)
    asked = {"targets": np.full(12, np.nan), "gains": GAINS, "damped": True}
    command = commanded(GO2, followed, SETTINGS, 1.0, **asked)
    wrong = commanded(GO2, followed.damped(Fault.LEANS, 0.5), SETTINGS, 1.0, **asked)
    for own, other in zip(command, wrong, strict=True):
        np.testing.assert_array_equal(own, other)
    assert command.is_damping
