"""Scores, scenarios and ratios."""

from copy import copy
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

import glassgait.studies.common.cases
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario, load_scenario, load_scenarios
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.symbolic import SymbolicPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.formula import parse_formula
from glassgait.models.task.gait import Transition, load_gait
from glassgait.models.task.observation import ITERATIONS_SCALE
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.cases import Case, alternation_cases, cases_in_worlds, run_rollouts
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.gait_figure import gait_figure
from glassgait.studies.common.observers import RolloutLog
from glassgait.studies.common.rollouts import RolloutConfig, roll_out
from glassgait.studies.common.scores import (
    interval,
    return_shares,
    score_rollouts,
    summarize,
)
from glassgait.studies.distillation.linear import untrained_student
from glassgait.studies.evaluation.alternation import return_figure, standalone_table
from glassgait.studies.evaluation.scenarios import falls_table, scorecard_table

A1 = load_robot()


TRAINING = {"training": Scenario()}


def log(n_steps=200, n_robots=2):
    shape = (n_steps, n_robots)
    return RolloutLog(
        velocity=np.zeros((*shape, 2)),
        command=np.zeros((*shape, 2)),
        power=np.zeros(shape),
        action=np.zeros((*shape, 12)),
        expert_acts=np.zeros(shape, dtype=bool),
        reward=np.ones(shape),
        plain_reward=np.full(shape, 0.5),
        served_dwell=np.full(shape, 0.9),
        failures=np.zeros((*shape, len(FAILURES)), dtype=bool),
    )


def test_a_robot_is_scored_up_to_its_first_failure():
    values = log()
    values.failures[49, 1, 1] = True
    values.failures[60:, 1, 0] = True
    scores = score_rollouts(values, A1.mass)
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
    errors = score_rollouts(values, A1.mass)["going_speed_error"]
    np.testing.assert_allclose(errors, [0.2, 0.0], atol=1e-12)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_standing_as_commanded_does_not_lower_the_speed_error():
    values = log(n_steps=1000)
    # The first robot stands for 10 s, then goes too slowly; the second is never commanded to go.
    values.command[500:, 0, 0] = 0.5
    values.velocity[500:, 0, 0] = 0.4
    values.velocity[..., 1] = 0.3
    scores = score_rollouts(values, A1.mass)
    np.testing.assert_allclose(scores["going_speed_error"], [0.1, np.nan], atol=1e-12)
    np.testing.assert_allclose(scores["yaw_rate_error"], 0.3)
    table = scorecard_table(scores.assign(gait="trot", scenario="training"), {"training": "home"})
    assert table.loc[0, "speed error, commanded to go (m/s)"] == "0.100"


def test_scores_of_another_definition_are_not_taken_again(expert, monkeypatch):
    def digest():
        worlds, config = {"training": Scenario()}, RolloutConfig(n_seeds=1)
        (case,) = cases_in_worlds(load_gait("trot"), {"expert": alone(expert)}, worlds, config)
        return case.digest()

    before = digest()
    monkeypatch.setattr(glassgait.studies.common.cases, "SCORES", ("speed_error",))
    assert digest() != before


def test_intervals_are_students():
    values = pd.Series([1.0, 2.0, 4.0, 7.0])
    low, high = stats.t.interval(0.95, 3, loc=values.mean(), scale=stats.sem(values))
    assert interval(values) == pytest.approx((high - low) / 2)
    assert np.isnan(interval(pd.Series([1.0])))


def test_summary_counts_falls():
    scores = score_rollouts(log(n_robots=4), A1.mass)
    scores["scenario"] = ["a", "a", "b", "b"]
    scores.loc[0, "fell"] = True
    summary = summarize(scores, ["scenario"])
    assert summary["falls"].tolist() == [1, 0]
    assert summary["fall_rate"].tolist() == [0.5, 0.0]


@pytest.fixture(scope="module")
def expert():
    return load_expert("trot")


def test_the_expert_trots_and_a_student_that_stands_does_not(expert, tmp_path):
    student = untrained_student(expert)
    config = RolloutConfig(n_robots=2, n_steps=100, n_seeds=1)
    jobs = alternation_cases(load_gait("trot"), expert, {"linear": student}, config, (1, 2, 0))
    scores = run_rollouts(jobs, tmp_path, processes=1)
    summary = summarize(scores, ["policy", "ratio"]).set_index(["policy", "ratio"])
    assert summary.loc[("expert", "1"), "falls"] == 0
    assert summary.loc[("expert", "1"), "rhythm"] > 0.9
    assert summary.loc[("linear", "0"), "rhythm"] < 0.1
    table = standalone_table(scores)
    assert table["policy"].tolist() == ["Neural expert", "Linear"]
    assert table["share of expert"].tolist()[0] == "1.000 ± 0.000"
    save_figure(return_figure(scores, "trot"), tmp_path / "return")
    assert (tmp_path / "return.pdf").stat().st_size > 5000


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
    scores = score_rollouts(values, A1.mass)
    assert scores["fell"].all()
    assert values.reward.shape == (800, 3)
    assert scores["steps"].max() < 100
    np.testing.assert_array_equal(values.reward[200:], np.repeat(values.reward[199:200], 600, 0))


def test_a_policy_without_an_action_is_reported_by_joint_and_step(expert, tmp_path, capsys):
    names = expert.observation_names
    # Of no value at the third control step in a state of the machine.
    bad = f"1e-3 / (x{names.index('RM Iters')} - {3 * ITERATIONS_SCALE / ITERATIONS_SCALE!r})"
    texts = [f"{target!r}" for target in A1.default_stance.tolist()]
    texts[2] = bad
    formulas = [parse_expression(text, variable_names(len(names))) for text in texts]
    student = SymbolicPolicy("trot", names, formulas)
    config = RolloutConfig(n_robots=3, n_steps=10)
    policy = alone(student, expert)
    job = Case({"policy": "formula"}, load_gait("trot"), policy, Scenario(), config.seed, config)
    scores = run_rollouts([job], tmp_path, processes=1)
    assert scores["failure"].tolist() == ["not_finite"] * 3
    assert scores["not_finite"].tolist() == ["FL_calf"] * 3
    assert scores["steps"].tolist() == [3] * 3
    message = " ".join(capsys.readouterr().out.split())
    assert "the action of FL_calf is not finite at control step 2, robot 0" in message


def test_shares_compare_robot_with_robot(generator):
    whole = pd.DataFrame({"return": generator.uniform(1000.0, 5000.0, size=40)})
    noise = generator.normal(scale=50.0, size=40)
    scores = pd.DataFrame({"policy": "a", "return": 0.9 * whole["return"] + noise})
    row = return_shares(scores, ["policy"], whole).iloc[0]
    assert row["share"] == scores["return"].mean() / whole["return"].mean()
    # As a bootstrap over robots finds it.
    picks = generator.integers(40, size=(4000, 40))
    resampled = scores["return"].to_numpy()[picks].mean(axis=1) / (
        whole["return"].to_numpy()[picks].mean(axis=1)
    )
    assert row["share_ci"] == pytest.approx(1.96 * resampled.std(), rel=0.15)
    unpaired = interval(scores["return"]) / whole["return"].mean()
    assert row["share_ci"] < 0.1 * unpaired


def test_scenarios_are_named_in_the_tables(expert, tmp_path):
    config = RolloutConfig(n_robots=2, n_steps=60, n_seeds=1)
    scenarios = load_scenarios(("training", "sap_2ms"))
    titles = {name: scenario.title for name, scenario in scenarios.items()}
    jobs = cases_in_worlds(load_gait("trot"), {"expert": alone(expert)}, scenarios, config)
    scores = run_rollouts(jobs, tmp_path, processes=1)
    scores = scores.assign(gait="trot")
    table, falls = scorecard_table(scores, titles), falls_table(scores, titles)
    assert table["scenario"].tolist() == ["SAP 10 ms (training)", "SAP 2 ms"]
    assert falls["scenario"].tolist() == ["SAP 10 ms (training)", "SAP 2 ms"]
    assert falls["trot"].tolist() == ["0 of 2", "0 of 2"]


def test_finished_rollouts_are_kept_unless_settings_differ(expert, tmp_path, monkeypatch):
    gait = load_gait("trot")

    def scores(*, seeds=2, folder=tmp_path):
        config = RolloutConfig(n_robots=2, n_steps=20, n_seeds=seeds)
        jobs = cases_in_worlds(gait, {"expert": alone(expert)}, TRAINING, config)
        return run_rollouts(jobs, folder, processes=1)

    rolled_out = []
    original = glassgait.studies.common.cases.roll_out
    monkeypatch.setattr(
        glassgait.studies.common.cases,
        "roll_out",
        lambda *job: rolled_out.append(job) or original(*job),
    )
    first = scores()
    assert len(rolled_out) == 2
    pd.testing.assert_frame_equal(scores(), first)
    assert len(rolled_out) == 2
    assert scores(seeds=3)["seed"].tolist() == [1000, 1000, 1001, 1001, 1002, 1002]
    assert len(rolled_out) == 3
    scores(folder=tmp_path / "other")
    assert len(rolled_out) == 5


def test_damaged_scores_are_refused(expert, tmp_path):
    config = RolloutConfig(n_robots=2, n_steps=20, n_seeds=1)
    jobs = cases_in_worlds(load_gait("trot"), {"expert": alone(expert)}, TRAINING, config)
    run_rollouts(jobs, tmp_path, processes=1)
    (path,) = tmp_path.glob("*.json")
    path.write_text(path.read_text().replace("return", "rewart", 1))
    with pytest.raises(InputError, match="is damaged; delete it, and --resume makes it anew"):
        run_rollouts(jobs, tmp_path, processes=1)


def test_scores_of_another_seed_are_not_taken(expert, tmp_path):
    config = RolloutConfig(n_robots=2, n_steps=20, n_seeds=2)
    jobs = cases_in_worlds(load_gait("trot"), {"expert": alone(expert)}, TRAINING, config)
    run_rollouts(jobs, tmp_path, processes=1)
    first, second = sorted(tmp_path.glob("*.json"))
    second.write_bytes(first.read_bytes())
    with pytest.raises(InputError, match="is of another run, or of another part"):
        run_rollouts(jobs, tmp_path, processes=1)


def test_processes_do_not_change_the_scores(expert, tmp_path):
    config = RolloutConfig(n_robots=2, n_steps=20, n_seeds=2)
    jobs = cases_in_worlds(load_gait("trot"), {"expert": alone(expert)}, TRAINING, config)
    one, two = (run_rollouts(jobs, tmp_path / str(n), processes=n) for n in (1, 2))
    pd.testing.assert_frame_equal(one, two)


def test_scenarios_disturb(expert):
    gait, config = load_gait("trot"), RolloutConfig(n_robots=2, n_steps=100, n_seeds=1)
    logs = {
        name: roll_out(gait, alone(expert), load_scenario(name), config)
        for name in ("training", "push_1.0", "friction_0.5", "payload_2kg", "true_body_state")
    }
    plain = logs.pop("training").velocity
    assert all(not np.array_equal(log.velocity, plain) for log in logs.values())


CONTINUOUS = Scenario("continuous", StationConfig(time_step=0.0), accuracy=1e-2, max_robots=1)


def test_a_loop_to_the_same_state_serves_no_rhythm_between_its_firings(expert):
    gait = load_gait("trot")
    anything = parse_formula("FL | ~FL")
    loops = tuple(Transition(q, q, anything) for q in ("q0", "q1"))
    gait = replace(gait, name="loops", transitions=loops)
    both = [copy(own) for own in (untrained_student(expert), expert)]
    for own in both:
        own.gait = gait.name
    standing = alone(*both)
    log = roll_out(gait, standing, CONTINUOUS, RolloutConfig(n_robots=1, n_steps=20))
    served = log.served_dwell[:, 0]
    (first, second) = np.flatnonzero(served)
    assert second - first == served.max() == served[first]


def test_cost_of_transport_is_work_per_weight_and_distance():
    values = log(n_steps=100, n_robots=1)
    values.power[:] = 50.0
    values.velocity[..., 0] = 0.5
    assert np.isnan(score_rollouts(values, A1.mass)["cost_of_transport"][0])
    values.command[50:, :, 0] = 0.4
    expected = 50.0 / (12.776 * 9.81 * 0.5)
    assert score_rollouts(values, A1.mass)["cost_of_transport"][0] == pytest.approx(expected)


@pytest.mark.slow
def test_diagram_rollouts_score_like_batch_rollouts(expert):
    gait, config = load_gait("trot"), RolloutConfig(n_robots=2, n_steps=100)
    cenic = load_scenario("cenic_1e-5")
    scores = score_rollouts(roll_out(gait, alone(expert), cenic, config), A1.mass)
    assert len(scores) == 1
    assert not scores["fell"].any()
    assert scores["rhythm"].min() > 0.8


def test_gait_figure_is_drawn(expert, tmp_path):
    gait = load_gait("trot")
    diagram = MakeLocomotion(gait, Scenario(command=FixedCommand()), policy=expert)
    rollout = record(make_simulator(diagram), 100)
    assert not rollout.failed
    save_figure(gait_figure(rollout, gait, "trot"), tmp_path / "gait")
    assert (tmp_path / "gait.png").stat().st_size > 3000


def test_a_single_robot_has_no_interval():
    scores = score_rollouts(log(n_robots=1), A1.mass).assign(gait="trot", scenario="training")
    row = scorecard_table(scores, {"training": "training"}).iloc[0]
    assert row["return"] == "200"
    assert row["cost of transport"] == "–"
