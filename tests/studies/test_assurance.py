"""Runtime assurance measured: warnings, rescues, tables, and the command."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.scenario import Pushes, Scenario
from glassgait.models.policies.controller import AssuredController, alone
from glassgait.models.policies.library import load_student
from glassgait.models.task.assurance import EnsembleDisagreement, Hysteresis, Region
from glassgait.models.task.observation import ObservationLayout
from glassgait.studies.cli import main
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.scores import SCORES
from glassgait.studies.evaluation import assurance_calibration
from glassgait.studies.evaluation.assurance import (
    Assurance,
    acting_title,
    assurance_table,
    readable_table,
)
from glassgait.studies.evaluation.assurance_calibration import (
    Calibration,
    Visits,
    guarded,
    period_of,
    rescues,
    visit,
    warnings_of,
)
from glassgait.studies.evaluation.assurance_figures import draw_calls

NAMES = ObservationLayout(2).names
HIP, SPEED = NAMES.index("DoF Pos FL Hip"), NAMES.index("Base Lin Vel Y")


def test_warnings_count_the_steps_without_a_gap_before_a_fall():
    region = Region(NAMES, np.full((2, 49), -1.0), np.full((2, 49), 1.0))
    observation = np.zeros((10, 3, 49))
    observation[1, 0, HIP] = 3.0
    observation[6:, 0, SPEED] = 3.0
    observation[6:, 1, SPEED] = 3.0
    visits = Visits(observation, np.array([8, 10, 5]))
    found = warnings_of(visits, region, Hysteresis(0.5, 0.2, return_steps=2))
    assert found.to_numpy().tolist() == [[0, 8, 3, "base velocity"], [2, 5, 0, "none"]]
    disagreeing = replace(
        region,
        disagreement=EnsembleDisagreement(
            lambda seen: abs(seen[..., HIP]), np.array([[0.0] * 2, [0.1] * 2])
        ),
    )
    observation[4, 2, HIP] = 0.5
    found = warnings_of(visits, disagreeing, Hysteresis(0.5, 0.2, return_steps=2))
    assert found.to_numpy()[1].tolist() == [2, 5, 2, "disagreement"]


def test_falls_are_taken_back_and_the_other_policy_goes_on(expert, trot, monkeypatch):
    monkeypatch.setattr(assurance_calibration, "LEADS", (1, 8, 32))
    monkeypatch.setattr(assurance_calibration, "RESCUE_STEPS", 60)
    student = alone(load_student("trot", "sparse_formula"), expert)
    world = Scenario(pushes=Pushes(speed=4.0, interval=0.5))
    visits = visit(trot, student, world, RolloutConfig(n_robots=4, n_steps=80, seed=3))
    fallen = len(visits.fallen)
    assert fallen > 1
    averted = rescues(trot, alone(expert), world, visits, seed=1)
    assert averted["lead"].tolist() == [1, 8, 32]
    # Later pushes are left out: who is taken back to before the one that felled it stays up.
    assert averted["rescued"].iloc[0] < fallen
    assert averted["rescued"].iloc[-1] > averted["rescued"].iloc[0]
    assert (averted["rescued"] <= averted["falls"]).all() and (averted["falls"] <= fallen).all()


def test_visits_are_those_of_the_rollouts_that_are_scored(expert, trot):
    student = load_student("trot", "sparse_formula")
    names = student.observation_names
    upper = np.full((2, len(names)), 100.0)
    upper[:, names.index("Base Lin Vel Y")] = 0.3
    region = Region(names, -upper, upper)
    study = Assurance(
        scenario=("training",), calls=(0.05,), n_robots=2, n_steps=40, n_seeds=2, seed=7
    )
    limits = {0.05: Hysteresis(0.05, 0.02, 3)}
    vars(study)["calibration"] = Calibration(region, limits, *[pd.DataFrame()] * 3)
    scores = pd.concat([study.measure(case) for case in study.cases()])
    assured = AssuredController(expert, student, region, limits[0.05])
    called = []
    for seed in study.seeds:
        config = RolloutConfig(n_robots=2, n_steps=40, seed=seed)
        observation = visit(trot, assured, Scenario(), config).observation
        called += guarded(region.overrun(observation), limits[0.05]).mean(axis=0).tolist()
    shares = {name: own["expert_share"] for name, own in scores.groupby("controller")}
    assert shares["assured_0.05"].tolist() == pytest.approx(called)
    assert 0.0 < np.mean(called) < 1.0
    assert shares["expert"].eq(1.0).all() and shares["sparse_formula"].eq(0.0).all()
    # The schedule has as many calls, or a few more.
    assert shares["schedule_0.05"].mean() >= np.mean(called)


@pytest.mark.parametrize(("called", "period"), [(0.0, 0), (0.05, 20), (0.051, 19), (1.0, 1)])
def test_the_schedule_calls_as_often_or_more_often(called, period):
    assert period_of(called) == period


def scores_of(falls):
    rows = []
    for policy, (fallen, called) in falls.items():
        for robot in range(10):
            fell = robot < fallen
            row = dict.fromkeys(SCORES, 1.0) | {"policy": policy, "scenario": "training"}
            row |= {"robot": robot, "fell": fell, "steps": 10 if fell else 100}
            rows.append(row | {"expert_share": 0.5 if fell else called})
    return pd.DataFrame(rows)


@pytest.fixture
def table():
    falls = {"expert": (1, 1.0), "sparse_formula": (4, 0.0), "assured_0.05": (2, 0.05)}
    return assurance_table(scores_of(falls | {"schedule_0.05": (3, 0.05)}), {"training": "calm"})


def test_calls_are_counted_by_steps_and_falls_beside_the_experts(table):
    row = table.set_index("policy").loc["assured_0.05"]
    assert row["called"] == pytest.approx((2 * 10 * 0.5 + 8 * 100 * 0.05) / 820)
    assert row["points_more"] == pytest.approx(10.0)
    assert row["fall_rate_low"] < 0.2 < row["fall_rate_high"]
    assert readable_table(table)["policy"].tolist() == [
        "Neural expert",
        "Page of formulas",
        "Assured, 5 % in training",
        "Schedule, as many as assured, 5 %",
    ]
    assert acting_title("assured_0.015") == "Assured, 1.5 % in training"


def test_the_figure_sets_falls_against_calls(table):
    (axes,) = draw_calls(table, {"training": "calm"}).axes
    assert axes.get_title() == "calm: 10 robots"
    points = {
        container.get_label(): container.lines[0].get_xydata().tolist()
        for container in axes.containers
    }
    assert points["outside of the region"] == [[pytest.approx(50 / 820), 0.2]]
    assert points["student"][0][1] == 0.4
    (expert,) = [line for line in axes.lines if line.get_label() == "expert"]
    assert expert.get_ydata()[0] == pytest.approx(0.1)


@pytest.fixture
def run(tmp_path):
    small = ["--n-robots", "2", "--n-steps", "30", "--nominal-robots", "2", "--pushed-robots", "2"]
    folder = tmp_path / "run"

    def start(*more):
        worlds = ["--scenario", "training", "--n-workers", "1", "--output", str(folder)]
        main(["evaluate", "assurance", *small, *worlds, *more])
        return folder

    return start


@pytest.mark.slow
def test_command_writes_all_and_resumes(run, monkeypatch):
    folder = run()
    names = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    tables = ("worlds", "fall_prediction", "warnings", "rescues")
    wanted = {f"{stem}.{end}" for stem in tables for end in ("csv", "md")}
    wanted |= {f"{stem}.{end}" for stem in ("calls", "pushed_robot") for end in ("png", "pdf")}
    wanted |= {"config.yaml", "metrics.json", "calibration.json", "pushed_robot.json", "cases"}
    assert names == wanted | {"region_q0.yaml", "region_q1.yaml"}
    metrics = json.loads((folder / "metrics.json").read_text())
    assert [row["policy"] for row in metrics["worlds"]] == [
        "expert",
        "sparse_formula",
        "assured_0.02",
        "schedule_0.02",
    ]

    def never(*_, **__):
        raise AssertionError("made anew")

    for module, name in [("calibration", "visit"), ("figures", "record")]:
        monkeypatch.setattr(f"glassgait.studies.evaluation.assurance_{module}.{name}", never)
    monkeypatch.setattr("glassgait.studies.common.cases.roll_out", never)
    before = (folder / "metrics.json").read_bytes()
    (folder / "metrics.json").unlink()
    assert (run("--resume") / "metrics.json").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--calls", "0"], "calls is (0.0,); it must be more than 0"),
        (["--calls", "1.5"], "calls is (1.5,); it must be 1 or less"),
        (["--quantile", "0.5"], "quantile is 0.5; it must be less than 0.5"),
        (["--return-steps", "0"], "return_steps is 0; it must be 1 or more"),
        (["--calibration-seed", "999"], "and rollouts have it or the next one; name another"),
        (["--gait", "three_one"], "--policy 'sparse_formula'"),
        (["--scenario", "moon"], "moon"),
        (["--disagreement"], "disagreement"),
        (["--policy", "expert"], "--policy expert"),
        (["--policy", "gbm", "ebm"], "--policy"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_a_sentence(refused, arguments, reported, tmp_path):
    folder = tmp_path / "run"
    assert reported in refused(["evaluate", "assurance", *arguments, "--output", str(folder)])
    assert not folder.exists()
