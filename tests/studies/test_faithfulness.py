"""Faithfulness: what a robot loses without an observation, beside its importance."""

import numpy as np
import pandas as pd
import pytest

from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.importance.faithfulness import AblatedController, losses, rank_correlations

NAMES = ObservationLayout(2, imu=True).names
N = len(NAMES)


def ablated(mode, **settings):
    expert = load_expert("trot")
    student = LinearPolicy("trot", NAMES, np.eye(12, N, k=2), np.zeros(12))
    return AblatedController(alone(student, expert), columns=(2, 4), mode=mode, **settings)


def act(controller, observations):
    memory = controller.begin(len(observations))
    return controller.advance(0, observations, memory).action


def test_means_stand_in_for_what_is_taken_away(generator):
    observations = generator.normal(size=(3, N))
    action = act(ablated("mean", means=(0.5, -0.5)), observations)
    np.testing.assert_array_equal(action[:, [0, 2]], [[0.5, -0.5]] * 3)
    np.testing.assert_array_equal(action[:, 1], observations[:, 3])


def test_shuffled_observations_are_another_robots(generator):
    observations = generator.normal(size=(20, N))
    action = act(ablated("shuffled"), observations)
    assert sorted(action[:, 0]) == sorted(observations[:, 2])
    assert not np.array_equal(action[:, 0], observations[:, 2])
    order = [int(np.flatnonzero(observations[:, 2] == value)[0]) for value in action[:, 0]]
    np.testing.assert_array_equal(action[:, 2], observations[order, 4])
    np.testing.assert_array_equal(action[:, 1], observations[:, 3])


def test_delayed_observations_are_the_step_befores(generator):
    controller = ablated("delayed")
    first, second = generator.normal(size=(2, 3, N))
    before = controller.advance(0, first, controller.begin(3))
    np.testing.assert_array_equal(before.action[:, 0], first[:, 2])
    action = controller.advance(1, second, before.memory).action
    np.testing.assert_array_equal(action[:, [0, 2]], first[:, [2, 4]])
    np.testing.assert_array_equal(action[:, 1], second[:, 3])


def test_losses_are_shares_of_the_whole_students_reward():
    scores = pd.DataFrame(
        {
            "policy": "linear",
            "without": ["nothing"] * 2 + ["RM Iters"] * 2 + ["Foot Height"] * 2,
            "mode": "mean",
            "return": [10.0, 20.0, 5.0, 10.0, 9.0, 18.0],
            "fell": [False, False, True, False, False, False],
        }
    )
    for name in (
        "plain_return",
        "rhythm",
        "going_speed_error",
        "yaw_rate_error",
        "way",
        "cost_of_transport",
    ):
        scores[name] = 1.0
    lost = losses(scores).set_index("without")
    assert lost["lost"].to_dict() == pytest.approx({"RM Iters": 0.5, "Foot Height": 0.1})
    assert lost.loc["RM Iters", "fall_rate"] == 0.5
    # Each robot loses the same share, so that the interval is nothing.
    assert lost["lost_ci"].to_numpy() == pytest.approx(0.0, abs=1e-12)


def test_ranks_are_correlated():
    groups = ["a", "b", "c", "d"]
    importances = pd.DataFrame(
        {"policy": "x", "method": "impurity", "without": groups, "importance": [1, 2, 3, 4]}
    )
    lost = pd.DataFrame({"policy": "x", "without": groups, "mode": "mean", "lost": [1, 2, 9, 20]})
    assert rank_correlations(importances, lost)["correlation"].tolist() == [1.0]
