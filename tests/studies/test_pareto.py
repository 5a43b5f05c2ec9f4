"""The front of size against reward."""

import math
from functools import partial

import numpy as np
import pandas as pd
import pytest
import yaml

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.distillation import pareto
from glassgait.studies.distillation.formula_families import FAMILIES, families_of, sizes_of
from glassgait.studies.distillation.pareto import pareto_table, smallest_that_walk
from glassgait.studies.distillation.pareto_figure import pareto_figure
from glassgait.studies.distillation.refinement import study
from glassgait.studies.distillation.refinement.config import RefinementConfig
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.distillation.students.sparse_formula import condense
from glassgait.studies.distillation.students.student import TrainingSet
from glassgait.studies.training.config import PpoConfig

NAMES = load_expert("trot").observation_names


@pytest.fixture(scope="module")
def samples():
    generator = np.random.default_rng(0)
    observations = generator.normal(size=(600, len(NAMES)))
    state = generator.integers(2, size=600)
    observations[:, machine_state_entries(NAMES)] = np.eye(2)[state]
    actions = np.where(state == 0, 1.0, -1.0)[:, None] * observations[:, 2:14]
    return Dataset(observations, actions, np.repeat(np.arange(1, 11), 60))


def training_set(data, mirror):
    return TrainingSet("trot", NAMES, data.observations, data.actions, data.starts, mirror)


@pytest.mark.parametrize("family", ["mirrored", "unmirrored"])
def test_terms_are_counted(family, samples):
    own = FAMILIES[family]
    data = training_set(samples, (1, 0))
    n_formulas = {"mirrored": 12, "unmirrored": 24}[family]
    assert own.possible_terms(data) == range(n_formulas, 41 * n_formulas + 1)
    assert sizes_of(own, data, (n_formulas - 1, 41 * n_formulas + 1)) == []
    sizes = sizes_of(own, data, (20, 30, 40))
    fitted = condense(data, sizes, mirrored=own.mirrored)
    assert [fitted[size].n_terms() for size in sizes] == sizes
    assert sizes == {"mirrored": [20, 30, 40], "unmirrored": [30, 40]}[family]


def test_a_gait_that_favours_a_side_has_no_mirrored_formulas(samples):
    assert [*families_of(training_set(samples, None), refined=True)] == ["unmirrored"]
    with_mirror = training_set(samples, (1, 0))
    assert [*families_of(with_mirror, refined=False)] == ["mirrored", "unmirrored"]
    assert [*families_of(with_mirror, refined=True)] == [*FAMILIES]


def test_the_smallest_that_walk_are_named():
    fits = pd.DataFrame(
        {
            "policy": ["a", "b", "c"],
            "family": ["mirrored", "unmirrored", "unmirrored"],
            "terms": [90, 40, 30],
            "r2": 0.9,
        }
    )
    scores = pd.DataFrame(
        {"policy": ["expert", "a", "a", "b", "b", "c"], "return": [10, 9, 9, 8, 4, 1]}
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
    scores["fell"] = [False, False, False, False, True, False]
    scores.loc[5, "rhythm"] = 0.0
    front = pareto_table(fits, scores)
    assert front["policy"].tolist() == ["c", "b", "a"]
    assert front["share"].tolist() == pytest.approx([0.1, 0.6, 0.9])
    smallest = smallest_that_walk(front, front)
    assert smallest["share asked for"].tolist() == [0.0, 0.9]
    assert smallest["formulas"].tolist() == ["mirrored", "mirrored"]
    assert smallest["terms"].tolist() == [90, 90]
    none = smallest_that_walk(front[front["falls"] > 0], front)
    assert none.empty and list(none.columns) == list(smallest.columns)


def test_fronts_of_gaits_stand_side_by_side_with_radii_where_there_are():
    front = pd.DataFrame({"family": "mirrored", "terms": [80, 100, 200], "share": 0.5, "r2": 0.9})
    front = front.assign(share_ci=0.1, fall_rate=0.0, fall_rate_low=0.0, fall_rate_high=0.1)
    assert len(pareto_figure({"Trot": front}).axes) == 3
    bounds = front.assign(radius=[math.nan, math.nan, 1.8], greatest_radius=[1.0, 1.0, 2.3])
    figure = pareto_figure({"Trot": front, "Bound": bounds})
    assert len(figure.axes) == 8
    # The row's panels share an axis, and it reaches what the last one shows.
    assert all(panel.get_ylim()[1] > 2.3 for panel in figure.axes[6:])
    labels = [label.get_text() for label in figure.axes[-1].get_xticklabels()]
    assert labels == ["", "100", "200"]


def test_command_writes_table_figure_and_formulas(samples, tmp_path, capsys, monkeypatch):
    few = {
        "n_robots": 4,
        "candidate_steps": 10,
        "worlds": DomainRandomization(n_groups=1, mujoco_share=0.0),
        "ppo": PpoConfig(steps_per_update=8, critic_layers=(16,), epochs=1, initial_std=0.1),
    }
    monkeypatch.setattr(study, "SEEN_STEPS", 10)
    monkeypatch.setattr(pareto, "RefinementConfig", partial(RefinementConfig, **few))
    samples.save(tmp_path / "rounds" / "round_1.safetensors")
    small = [
        "--terms",
        "20",
        "30",
        "9999",
        "--refined-updates",
        "1",
        "--n-robots",
        "2",
        "--n-steps",
        "20",
    ]
    output = tmp_path / "pareto"
    where = ["--samples", str(tmp_path / "rounds"), "--output", str(output)]
    main(["distill", "--sweep", "terms", *small, *where])
    assert {path.name for path in output.glob("pareto.*")} == {
        "pareto.csv", "pareto.md", "pareto.png", "pareto.pdf",
    }  # fmt: skip
    assert (output / "smallest.csv").exists()
    # As many robots choose as are reported, and they are others.
    chosen, reported = (pd.read_csv(output / f"{name}.csv") for name in ("selection", "pareto"))
    assert chosen["policy"].tolist() == reported["policy"].tolist()
    assert chosen["robots"].tolist() == reported["robots"].tolist() == [2] * 5
    assert np.all(chosen["return"] != reported["return"])
    assert {path.stem for path in (output / "formulas").iterdir()} == {
        "mirrored_20", "mirrored_30", "unmirrored_30", "refined_20", "refined_30",
    }  # fmt: skip
    said = capsys.readouterr().out
    assert "left out: 9999 terms" in said and "left out: 20, 9999 terms" in said
    assert "written to" in said


def test_missing_samples_are_refused(tmp_path, refused):
    assert "holds no samples" in refused(
        ["distill", "--sweep", "terms", "--samples", str(tmp_path)]
    )


def test_of_a_runs_folder_that_of_a_student_is_named(samples, tmp_path, refused):
    samples.save(tmp_path / "gbm" / "round_1.safetensors")
    message = refused(["distill", "--sweep", "terms", "--samples", str(tmp_path)])
    assert str(tmp_path / "gbm") in message
    assert "--students" not in message


@pytest.mark.parametrize("key", ["gait", "expert"])
def test_samples_of_another_gait_or_expert_are_refused(key, samples, tmp_path, refused):
    samples.save(tmp_path / "run" / "gbm" / "round_1.safetensors")
    inputs = {"gait": load_gait("trot").digest(), "expert": load_expert("trot").digest()}
    record = {"study": "distill", "settings": {}, "inputs": inputs | {key: "0"}, "software": {}}
    (tmp_path / "run" / "config.yaml").write_text(yaml.safe_dump(record))
    output = tmp_path / "out"
    where = ["--samples", str(tmp_path / "run" / "gbm"), "--output", str(output)]
    assert f"inputs.{key}" in refused(["distill", "--sweep", "terms", *where])
    assert not output.exists()


def test_samples_of_other_observations_are_refused(samples, tmp_path, refused):
    samples.save(tmp_path / "rounds" / "round_1.safetensors")
    output = tmp_path / "out"
    where = ["--samples", str(tmp_path / "rounds"), "--output", str(output)]
    assert "57 observations" in refused(["distill", "--sweep", "terms", "--gait", "walk", *where])
    assert not output.exists()


@pytest.mark.parametrize("terms", ["5", "9999"])
def test_numbers_of_terms_that_no_formulas_have_are_refused(terms, samples, tmp_path, refused):
    samples.save(tmp_path / "rounds" / "round_1.safetensors")
    where = ["--samples", str(tmp_path / "rounds"), "--output", str(tmp_path / "out")]
    message = refused(["distill", "--sweep", "terms", "--terms", terms, *where])
    assert f"terms is ({terms},)" in message and "12 to 984" in message
    assert not (tmp_path / "out").exists()


def test_samples_are_of_one_gait(tmp_path, refused):
    named = ["--gait", "trot", "pace", "--samples", str(tmp_path)]
    assert "--samples: are those of one gait" in refused(["distill", "--sweep", "terms", *named])
