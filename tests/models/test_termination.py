"""Failures, each provoked without the others."""

import numpy as np
import pytest

from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.termination import FAILURES, PHYSICAL_FALL, TerminationLimits, failures

A1 = load_robot()


LIMITS = TerminationLimits()
STILL = np.zeros(12)


def shown(state, action=STILL, previous=STILL, limits=LIMITS):
    flags = failures(A1, state, action=action, previous_action=previous, limits=limits)
    return {name for name, flag in zip(FAILURES, flags, strict=True) if flag}


def test_a_robot_shows_nothing_standing_and_a_failure_low_on_its_side_or_in_the_air(standing):
    assert shown(standing) == set()
    low, lying, high = standing.copy(), standing.copy(), standing.copy()
    low[6] = 0.19
    assert "low_trunk" in shown(low)
    lying[:4] = [np.cos(np.pi / 4), np.sin(np.pi / 4), 0, 0]
    lying[6] = 0.08
    assert "body_contact" in shown(lying)
    high[6] += 0.26
    assert shown(high) == {"high_foot"}


def leaning(state, degrees):
    half = np.radians(degrees) / 2
    state[:4] = [np.cos(half), np.sin(half), 0, 0]
    state[6] = 1.0
    return state


def test_a_physical_fall_is_a_trunk_or_thigh_on_the_ground_or_a_great_lean(standing):
    assert shown(leaning(standing.copy(), 59), limits=PHYSICAL_FALL) == set()
    assert shown(leaning(standing.copy(), 61), limits=PHYSICAL_FALL) == {"lean"}
    lying = standing.copy()
    lying[6] = 0.05
    assert shown(lying, limits=PHYSICAL_FALL) == {"body_contact"}
    kneeling = on_its_knees(standing, clearance=0.005)
    assert "body_contact" in shown(kneeling)
    assert shown(kneeling, limits=PHYSICAL_FALL) == set()


def on_its_knees(state, clearance):
    """Bends the legs until the feet are above the knees, and the knees `clearance` (m) up."""
    state[quadruped.JOINT_POSITION] = np.tile([0.0, 0.1, -0.1 - np.pi / 2 - 0.2], 4)
    state[6] = 0.0
    legs = kinematics.leg_angles(state[quadruped.JOINT_POSITION])
    _, knees, _ = kinematics.leg_points(A1, legs)
    state[6] = clearance - knees[..., 2].min()
    return state


def test_a_calf_may_be_as_deep_in_the_ground_as_its_foot(standing):
    standing[6] -= 0.03
    assert shown(standing) == set()
    assert "body_contact" in shown(on_its_knees(standing, clearance=0.005))


def test_what_the_task_alone_ends_is_no_physical_fall(standing):
    standing[6] += 0.26
    standing[quadruped.JOINT_POSITION][0] = 0.9
    assert shown(standing, action=np.full(12, 2.3), limits=PHYSICAL_FALL) == set()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_shows_that_alone(standing, bad):
    standing[20] = bad
    assert shown(standing) == {"not_finite"}
    standing[20] = 0.0
    assert shown(standing, action=np.full(12, bad)) == {"not_finite"}
