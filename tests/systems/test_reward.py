"""The reward and the fall monitor as systems."""

import numpy as np
import pytest

from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.reward import RewardWeights, step_reward
from glassgait.models.task.termination import FAILURES, TerminationLimits
from glassgait.systems.reward import FallMonitor, RewardSystem

A1 = load_robot()
STILL = {"action": np.zeros(12), "previous_action": np.zeros(12)}


def inputs(state, **changes):
    return {
        "state": state,
        "command": np.array([0.3, 0.1]),
        **STILL,
        "foot_contact": np.ones(4),
        "foot_height": np.zeros(4),
        "reward_multiplier": 1.0,
    } | changes


def test_the_reward_remembers_joint_velocities_and_air_times(standing, fix_inputs, latch):
    system = RewardSystem(A1)
    standing[quadruped.JOINT_VELOCITY] = np.arange(12.0)
    context = fix_inputs(system, **inputs(standing, foot_contact=np.array([1.0, 1, 1, 0])))
    clone = context.Clone()
    latch(system, context)
    latch(system, context)
    moved = standing.copy()
    moved[quadruped.JOINT_VELOCITY] += 1.0
    fix_inputs(system, context, **inputs(moved, reward_multiplier=1000.0))
    expected = step_reward(
        A1,
        moved,
        previous_joint_velocity=np.arange(12.0),
        **STILL,
        command=np.array([0.3, 0.1]),
        foot_contact=np.ones(4, dtype=bool),
        foot_height=np.zeros(4),
        air_time=np.array([0, 0, 0, 0.02]),
        tracked=np.zeros(2),
        weights=RewardWeights(),
    )
    for port, value in (
        ("reward_terms", expected.terms),
        ("plain_reward", [expected.plain]),
        ("reward", [1000 * expected.plain]),
    ):
        np.testing.assert_array_equal(system.GetOutputPort(port).Eval(context), value)
    # A clone has its memory: its joints were at rest.
    assert system.GetOutputPort("reward_terms").Eval(clone)[5] < 0


@pytest.mark.parametrize(
    ("values", "limits", "shown"),
    [
        ({}, {}, set()),
        ({"action": np.full(12, 3.0)}, {}, {"abrupt_action"}),
        ({}, {"trunk_height": 0.4}, {"low_trunk"}),
        ({"state": np.full(37, np.nan)}, {}, {"not_finite"}),
        ({"is_sound": 0.0}, {}, {"not_finite"}),
    ],
)
def test_the_monitor_flags_failures(standing, fix_inputs, values, limits, shown):
    system = FallMonitor(A1, TerminationLimits(**limits))
    context = fix_inputs(system, **{"state": standing, **STILL, "is_sound": 1.0} | values)
    flags = system.get_output_port().Eval(context)
    assert {name for name, flag in zip(FAILURES, flags, strict=True) if flag} == shown
