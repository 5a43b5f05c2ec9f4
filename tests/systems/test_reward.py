"""The reward as a system."""

import numpy as np

from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.reward import RewardWeights, step_reward
from glassgait.systems.reward import RewardSystem

A1 = load_robot()


def inputs(state, **changes):
    values = {
        "state": state,
        "command": np.array([0.3, 0.1]),
        "action": np.zeros(12),
        "previous_action": np.zeros(12),
        "foot_contact": np.ones(4),
        "foot_height": np.zeros(4),
        "reward_multiplier": 1.0,
    }
    return values | changes


def test_latches_joint_velocities_and_air_times(standing, fix_inputs, latch):
    system = RewardSystem(A1)
    standing[quadruped.JOINT_VELOCITY] = np.arange(12.0)
    up = np.array([1.0, 1.0, 1.0, 0.0])
    context = fix_inputs(system, **inputs(standing, foot_contact=up))
    latch(system, context)
    latch(system, context)
    moved = standing.copy()
    moved[quadruped.JOINT_VELOCITY] += 1.0
    fix_inputs(system, context, **inputs(moved, reward_multiplier=1000.0))
    expected = step_reward(
        A1,
        moved,
        previous_joint_velocity=np.arange(12.0),
        action=np.zeros(12),
        previous_action=np.zeros(12),
        command=np.array([0.3, 0.1]),
        foot_contact=np.ones(4, dtype=bool),
        foot_height=np.zeros(4),
        air_time=np.array([0, 0, 0, 0.02]),
        fall_speed=np.zeros(4),
        tracked=np.zeros(2),
        weights=RewardWeights(),
    )
    np.testing.assert_array_equal(
        system.get_reward_terms_output_port().Eval(context), expected.terms
    )
    assert system.get_plain_reward_output_port().Eval(context)[0] == expected.plain
    assert system.get_reward_output_port().Eval(context)[0] == 1000 * expected.plain


def test_clones_keep_their_own_memory(standing, fix_inputs, latch):
    system = RewardSystem(A1)
    standing[quadruped.JOINT_VELOCITY] = 5.0
    context = fix_inputs(system, **inputs(standing))
    clone = context.Clone()
    latch(system, context)
    acceleration = [system.get_reward_terms_output_port().Eval(c)[5] for c in (context, clone)]
    assert acceleration[0] == 0
    assert acceleration[1] < 0


def test_its_weights_weigh_the_terms(standing, fix_inputs):
    context, once = {}, {}
    for factor in (1.0, 2.0):
        system = RewardSystem(A1, RewardWeights(forward_tracking=factor))
        context = fix_inputs(system, **inputs(standing))
        once[factor] = system.get_reward_terms_output_port().Eval(context)
    assert once[2.0][0] == 2 * once[1.0][0] > 0
    np.testing.assert_array_equal(once[2.0][1:], once[1.0][1:])


def test_averages_speeds_over_the_steps_before(standing, fix_inputs, latch):
    weights = RewardWeights(tracking_time=0.1)
    system = RewardSystem(A1, weights)
    standing[quadruped.LINEAR_VELOCITY] = [0.4, 0.0, 0.0]
    context = fix_inputs(system, **inputs(standing))
    for _ in range(4):
        latch(system, context)
    reached = 0.4 * (1 - np.exp(-5 * 0.02 / 0.1))
    terms = system.get_reward_terms_output_port().Eval(context)
    np.testing.assert_allclose(terms[0], np.exp(-np.square(0.3 - reached) / 0.25), rtol=1e-12)
