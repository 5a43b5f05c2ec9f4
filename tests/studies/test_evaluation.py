"""Scores, worlds and ratios."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from diagrams.locomotion import LocomotionConfig, MakeLocomotion
from diagrams.rollout import make_simulator, record
from models.policies.library import load_expert
from models.task.gait import load_gait
from studies.distillation.students import untrained_student
from studies.evaluation.alternation import evaluate_alternation, ratio_title
from studies.evaluation.config import WORLDS, RolloutConfig
from studies.evaluation.figures import gait_figure, reward_figure
from studies.evaluation.rollouts import Team, roll_out
from studies.evaluation.scores import RolloutLog, interval, score_rollouts, summarize
from studies.evaluation.tables import standalone_table, world_table
from studies.evaluation.worlds import evaluate_worlds
from studies.figures import save_figure


def log(n_steps=200, n_robots=2):
    shape = (n_steps, n_robots)
    return RolloutLog(
        velocity=np.zeros((*shape, 2)),
        command=np.zeros((*shape, 2)),
        reward=np.ones(shape),
        plain_reward=np.full(shape, 0.5),
        served_dwell=np.full(shape, 0.9),
        failures=np.zeros((*shape, 6), dtype=bool),
    )


def test_a_robot_is_scored_up_to_its_first_failure():
    values = log()
    values.failures[49, 1, 1] = True
    values.failures[60:, 1, 0] = True
    scores = score_rollouts(values)
    assert scores["fell"].tolist() == [False, True]
    assert scores["steps"].tolist() == [200, 50]
    assert scores["reward"].tolist() == [200, 50]
    assert scores["failure"].tolist() == ["", "low_trunk"]
    np.testing.assert_allclose(scores["rhythm"], 0.9)


def test_tracking_is_of_one_second_averages_after_the_first_second():
    values = log()
    values.velocity[:50, :, 0] = 9.0
    values.velocity[50:, 0, 0] = 0.2
    values.velocity[50:, 1, 0] = 0.3 * np.where(np.arange(150) % 2, 1, -1)
    errors = score_rollouts(values)["speed_error"]
    np.testing.assert_allclose(errors, [0.2, 0.0], atol=1e-12)


def test_intervals_are_students():
    values = pd.Series([1.0, 2.0, 4.0, 7.0])
    low, high = stats.t.interval(0.95, 3, loc=values.mean(), scale=stats.sem(values))
    assert interval(values) == pytest.approx((high - low) / 2)
    assert np.isnan(interval(pd.Series([1.0])))


def test_summary_counts_falls():
    scores = score_rollouts(log(n_robots=4))
    scores["world"] = ["a", "a", "b", "b"]
    scores.loc[0, "fell"] = True
    summary = summarize(scores, ["world"])
    assert summary["falls"].tolist() == [1, 0]
    assert summary["fall_rate"].tolist() == [0.5, 0.0]


def test_ratios_are_named_as_in_the_paper():
    assert [ratio_title(period) for period in (1, 2, 8, 0)] == ["1", "1/2", "1/8", "0"]


@pytest.fixture(scope="module")
def expert():
    return load_expert("trot")


def test_the_expert_trots_and_a_student_that_stands_does_not(expert, tmp_path):
    student = untrained_student("trot", expert.observation_names)
    scores = evaluate_alternation(
        load_gait("trot"),
        expert,
        {"linear": student},
        RolloutConfig(n_robots=4, n_steps=150),
        lambda line: None,
        periods=(1, 2, 0),
    )
    summary = summarize(scores, ["policy", "ratio"]).set_index(["policy", "ratio"])
    assert summary.loc[("expert", "1"), "falls"] == 0
    assert summary.loc[("expert", "1"), "rhythm"] > 0.9
    assert summary.loc[("linear", "0"), "rhythm"] < 0.1
    table = standalone_table(scores)
    assert table["policy"].tolist() == ["Neural expert", "Linear"]
    assert table["share of expert"].tolist()[0] == 1.0
    save_figure(reward_figure(scores, "trot"), tmp_path / "reward")
    assert (tmp_path / "reward.pdf").stat().st_size > 5000


def test_worlds_are_named_in_the_table(expert):
    scores = evaluate_worlds(
        load_gait("trot"),
        Team(expert),
        ("training", "sap_2ms"),
        RolloutConfig(n_robots=2, n_steps=60),
        lambda line: None,
    )
    assert world_table(scores)["world"].tolist() == ["SAP 10 ms (training)", "SAP 2 ms"]


@pytest.mark.slow
def test_diagram_rollouts_score_like_batch_rollouts(expert):
    gait, config = load_gait("trot"), RolloutConfig(n_robots=2, n_steps=100)
    cenic = WORLDS["cenic_1e-5"]
    scores = score_rollouts(roll_out(gait, Team(expert), cenic, config))
    assert len(scores) == 2
    assert not scores["fell"].any()
    assert scores["rhythm"].min() > 0.8


def test_gait_figure_is_drawn(expert, tmp_path):
    gait = load_gait("trot")
    diagram = MakeLocomotion(gait, LocomotionConfig(), expert=expert, estimator=expert.estimator)
    rollout = record(make_simulator(diagram), 100)
    assert not rollout.failed
    save_figure(gait_figure(rollout, gait, "trot"), tmp_path / "gait")
    assert (tmp_path / "gait.png").stat().st_size > 3000
