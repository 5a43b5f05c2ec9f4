"""The reward, term by term, compared with numbers calculated by hand."""

import numpy as np
import pytest

from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task.reward import REWARD_TERMS, RewardWeights, step_reward

A1 = load_robot()


def reward(state, **changes):
    arguments = {
        "state": state,
        "previous_joint_velocity": state[quadruped.JOINT_VELOCITY],
        "action": np.zeros(12),
        "previous_action": np.zeros(12),
        "command": np.zeros(2),
        "foot_contact": np.ones(4, dtype=bool),
        "foot_height": np.zeros(4),
        "air_time": np.zeros(4),
        "tracked": np.zeros(2),
        "weights": RewardWeights(),
    }
    outcome = step_reward(A1, **(arguments | changes))
    return outcome, dict(zip(REWARD_TERMS, outcome.terms, strict=True))


def test_standing_still_as_commanded_earns_the_tracking_terms(standing):
    outcome, terms = reward(standing)
    assert terms["forward_tracking"] == pytest.approx(1.0)
    assert terms["yaw_tracking"] == pytest.approx(0.5)
    assert sum(terms.values()) == pytest.approx(1.5)
    assert outcome.plain == pytest.approx(0.03)


def test_tracking_falls_with_the_squared_error(standing):
    _, terms = reward(standing, command=np.array([0.5, -0.5]))
    assert terms["forward_tracking"] == pytest.approx(np.exp(-1))
    assert terms["yaw_tracking"] == pytest.approx(0.5 * np.exp(-1))


def test_averaged_speeds_are_what_a_robot_did_of_late(standing):
    weights = RewardWeights(tracking_time=0.3)
    standing[quadruped.LINEAR_VELOCITY] = [0.5, 0.0, 0.0]
    tracked, command = np.zeros(2), np.array([0.5, 0.0])
    for _ in range(30):
        outcome, terms = reward(standing, tracked=tracked, weights=weights, command=command)
        tracked = outcome.tracked
    # 0.6 s are two time constants.
    assert tracked[0] == pytest.approx(0.5 * (1 - np.exp(-2.0)))
    assert terms["forward_tracking"] == pytest.approx(np.exp(-np.square(0.5 * np.exp(-2.0)) / 0.25))


def test_penalties(standing):
    state = standing.copy()
    state[quadruped.LINEAR_VELOCITY] = [0, 0, 0.3]
    state[quadruped.ANGULAR_VELOCITY] = [0.5, 0.5, 0]
    state[quadruped.JOINT_VELOCITY] = 1.0
    _, terms = reward(state, previous_joint_velocity=np.zeros(12), action=np.full(12, 0.5))
    assert terms["vertical_velocity"] == pytest.approx(-2 * 0.09)
    assert terms["roll_pitch_rate"] == pytest.approx(-0.05 * 0.5)
    assert terms["joint_acceleration"] == pytest.approx(-2.5e-7 * 12 * 50**2)
    assert terms["action_change"] == pytest.approx(-0.01 * 12 * 0.25)
    assert terms["torque"] == pytest.approx(-2e-4 * 12 * (40 * 0.125 - 1.0) ** 2)


def test_excursion_past_ninety_percent_of_the_range_costs(standing):
    state = standing.copy()
    state[quadruped.JOINT_POSITION][0] = 0.8029
    _, terms = reward(state)
    assert terms["joint_limits"] == pytest.approx(-10 * 0.1 * 0.8029)


def test_air_time_counts_at_touch_down_and_only_when_commanded_to_move(standing):
    flown = np.array([0.58, 0.0, 0.0, 0.0])
    outcome, terms = reward(standing, air_time=flown, command=np.array([0.5, 0.0]))
    assert terms["air_time"] == pytest.approx(0.6 - 0.5)
    np.testing.assert_array_equal(outcome.air_time, 0.0)
    _, terms = reward(standing, air_time=flown)
    assert terms["air_time"] == 0.0


def test_feet_that_swing_high_cost_what_is_above_the_bound(standing):
    weights = RewardWeights(high_swing=-2.0)
    _, terms = reward(standing, weights=weights, foot_height=np.array([0.0, 0.05, 0.1, 0.15]))
    assert terms["high_swing"] == pytest.approx(-0.1)


def test_a_trunk_that_leans_costs_the_squared_sine(standing):
    standing[quadruped.QUATERNION] = np.cos(0.1), 0.0, np.sin(0.1), 0.0
    _, terms = reward(standing, weights=RewardWeights(tilt=-3.0))
    assert terms["tilt"] == pytest.approx(-3.0 * np.sin(0.2) ** 2)


def test_feet_on_the_ground_cost_their_squared_speed(standing):
    standing[quadruped.LINEAR_VELOCITY] = 0.3, 0.4, 0.0
    height = np.array([0.0, 0.0, 0.01, 0.1])
    _, terms = reward(standing, weights=RewardWeights(slip=-1.0), foot_height=height)
    assert terms["slip"] == pytest.approx(-2 * 0.25)


def test_plain_reward_is_never_negative(standing):
    outcome, _ = reward(standing, action=np.full(12, 50.0))
    assert outcome.plain == 0.0


def test_torques_are_charged_by_the_gains_that_act(standing):
    action = np.full(12, 0.1)
    _, own = reward(standing, action=action, previous_action=action)
    law = JointLaw((2.0 * A1.stiffness, A1.damping))
    _, firm = reward(standing, action=action, previous_action=action, joint_law=law)
    assert firm["torque"] == pytest.approx(4.0 * own["torque"]) != 0.0
    assert {name for name in own if own[name] != firm[name]} == {"torque"}
