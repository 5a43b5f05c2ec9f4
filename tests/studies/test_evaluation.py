"""Scores, scenarios and ratios."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.observers import RolloutLog
from glassgait.studies.common.rollouts import RolloutConfig, roll_out
from glassgait.studies.common.scores import interval, paired_share, score_rollouts, summarize
from glassgait.studies.common.tables import joined
from glassgait.studies.distillation.linear import untrained_student
from glassgait.studies.evaluation.alternation import alternation_scores
from glassgait.studies.evaluation.figures import return_figure
from glassgait.studies.evaluation.tables import standalone_table

A1 = load_robot()


def log(n_steps=200, n_robots=2):
    shape = (n_steps, n_robots)
    return RolloutLog(
        velocity=np.zeros((*shape, 2)),
        command=np.zeros((*shape, 2)),
        reward=np.ones(shape),
        plain_reward=np.full(shape, 0.5),
        served_dwell=np.full(shape, 0.9),
        failures=np.zeros((*shape, len(FAILURES)), dtype=bool),
    )


def test_a_robot_is_scored_up_to_its_first_failure():
    values = log()
    values.failures[49, 1, 1] = True
    values.failures[60:, 1, 0] = True
    scores = score_rollouts(values)
    assert scores["fell"].tolist() == [False, True]
    assert scores["steps"].tolist() == [200, 50]
    assert scores["return"].tolist() == [200, 50]
    assert scores["failure"].tolist() == ["", "low_trunk"]
    np.testing.assert_allclose(scores["rhythm"], 0.9)


def test_tracking_is_of_one_second_averages_after_the_first_second():
    values = log()
    values.command[..., 0] = 0.5
    values.velocity[:50, :, 0] = 9.0
    values.velocity[50:, 0, 0] = 0.7
    values.velocity[50:, 1, 0] = 0.5 + 0.3 * np.where(np.arange(150) % 2, 1, -1)
    errors = score_rollouts(values)["going_speed_error"]
    np.testing.assert_allclose(errors, [0.2, 0.0], atol=1e-12)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_standing_as_commanded_does_not_lower_the_speed_error():
    values = log(n_steps=1000)
    # The first robot stands for 10 s, then goes too slowly; the second is never commanded to go.
    values.command[500:, 0, 0] = 0.5
    values.velocity[500:, 0, 0] = 0.4
    values.velocity[..., 1] = 0.3
    scores = score_rollouts(values)
    np.testing.assert_allclose(scores["going_speed_error"], [0.1, np.nan], atol=1e-12)
    np.testing.assert_allclose(scores["yaw_rate_error"], 0.3)


def test_intervals_are_students():
    values = pd.Series([1.0, 2.0, 4.0, 7.0])
    low, high = stats.t.interval(0.95, 3, loc=values.mean(), scale=stats.sem(values))
    assert interval(values) == pytest.approx((high - low) / 2)
    assert np.isnan(interval(pd.Series([1.0])))


@pytest.fixture(scope="module")
def expert():
    return load_expert("trot")


def test_the_expert_trots_and_a_student_that_stands_does_not(expert, tmp_path):
    student = untrained_student(expert)
    config = RolloutConfig(n_robots=2, n_steps=60, n_seeds=1)
    students = {"linear": student}
    scores = alternation_scores(load_gait("trot"), expert, students, config, tmp_path, (1, 2, 0))
    summary = summarize(scores, ["policy", "ratio"]).set_index(["policy", "ratio"])
    assert summary.loc[("expert", 1.0), "falls"] == 0
    assert summary.loc[("expert", 1.0), "rhythm"] > 0.8
    assert summary.loc[("linear", 0.0), "rhythm"] < 0.1
    table = standalone_table(scores, {"expert": expert, **students})
    assert table["policy"].tolist() == ["expert", "linear"]
    assert table["share of the expert's return"].tolist()[0] == 1.0
    assert joined(table)["share of the plain return"].tolist()[0] == "1.000 ± 0.000"
    assert table["operations per action"].tolist() == [18679, 2 * len(expert.observation_names)]
    assert len(return_figure(scores, "trot").axes) == 3


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_policy_that_diverges_ends_the_rollout(expert):
    n = len(expert.observation_names)
    weights = np.zeros((quadruped.N_JOINTS, n))
    # Each action is three times the action before: beyond every float within the rollout.
    previous = expert.observation_names.index("Prev Action FL Hip")
    weights[:, previous : previous + quadruped.N_JOINTS] = 3.0 * np.eye(quadruped.N_JOINTS)
    student = LinearPolicy("trot", expert.observation_names, weights, np.ones(quadruped.N_JOINTS))
    config = RolloutConfig(n_robots=3, n_steps=800)
    values = roll_out(load_gait("trot"), alone(student, expert), Scenario(), config)
    scores = score_rollouts(values)
    assert scores["fell"].all()
    assert values.reward.shape == (800, 3)
    assert scores["steps"].max() < 100
    np.testing.assert_array_equal(values.reward[200:], np.repeat(values.reward[199:200], 600, 0))


def test_shares_compare_robot_with_robot(generator):
    whole = pd.DataFrame({"return": generator.uniform(1000.0, 5000.0, size=40)})
    noise = generator.normal(scale=50.0, size=40)
    scores = pd.DataFrame({"policy": "a", "return": 0.9 * whole["return"] + noise})
    share, half = paired_share(scores["return"], whole["return"])
    assert share == scores["return"].mean() / whole["return"].mean()
    # As a bootstrap over robots finds it.
    picks = generator.integers(40, size=(4000, 40))
    resampled = scores["return"].to_numpy()[picks].mean(axis=1) / (
        whole["return"].to_numpy()[picks].mean(axis=1)
    )
    assert half == pytest.approx(1.96 * resampled.std(), rel=0.15)
    unpaired = interval(scores["return"]) / whole["return"].mean()
    assert half < 0.1 * unpaired
