"""The benchmark times what it says it times."""

import itertools
import json
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.files import write_record
from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.policies import find_policies
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.boosting import (
    EbmSettings,
    GbmSettings,
    HistogramGbmSettings,
)
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.export.files import has_compiler
from glassgait.studies.reproduction.benchmark import command, controllers, python_times
from glassgait.studies.reproduction.benchmark.controllers import Times, call_times, fastest
from glassgait.studies.reproduction.benchmark.python_times import (
    NaiveModel,
    compiled_against_library,
    expert_samples,
    naive_minutes,
    study_against_naive_loop,
)
from glassgait.studies.reproduction.benchmark.throughput import training_and_physics
from glassgait.studies.training.config import PpoConfig, TrainingConfig


def test_training_and_physics_are_timed_over_the_same_steps():
    config = TrainingConfig(
        n_robots=4,
        worlds=DomainRandomization(n_groups=1, fine_steps=()),
        ppo=PpoConfig(steps_per_update=8),
    )
    rows = training_and_physics(config, None, n_updates=1, repeats=3)
    assert len(rows) == 3
    # Other jobs of the machine slow one timing of a few milliseconds, seldom all.
    best = {name: max(row[name] for row in rows) for name in rows[0]}
    assert best["physics"] > best["training"] > 0
    assert best["late_physics"] > best["training"]


@pytest.mark.slow
def test_compiled_students_are_timed_beside_the_libraries_that_they_equal():
    expert = load_expert("trot")
    samples = expert_samples(expert, n_steps=40)
    settings = StudentsSettings(
        gbm=GbmSettings(n_trees=5),
        histogram_gbm=HistogramGbmSettings(n_trees=5),
        ebm=EbmSettings(interactions=2, max_rounds=5),
    )
    table = compiled_against_library(samples, expert, settings)
    assert table["student"].tolist() == ["gbm", "histogram_gbm", "ebm"]
    assert (table["greatest difference"] < 1e-9).all()
    assert (table[["compiled (µs)", "predict × 12 (µs)"]] > 0).all(axis=None)


@pytest.fixture
def linear_models(monkeypatch: pytest.MonkeyPatch) -> dict[str, NaiveModel]:
    """Models of two parts, of which 800 samples take a second and 3200 three."""
    clock = itertools.cycle([0.0, 1.0, 10.0, 13.0])
    monkeypatch.setattr(python_times.time, "perf_counter", lambda: next(clock))
    models = {kind: NaiveModel(LinearRegression, 2, (800, 3200)) for kind in ("gbm", "ebm")}
    monkeypatch.setattr(python_times, "NAIVE_MODELS", models)
    return models


SAMPLES = Dataset(np.zeros((4000, 4)), np.zeros((4000, 12)), np.ones(4000, dtype=np.int64))
TWO_EPISODES = DistillationConfig(episodes=2, episode_steps=1000)


def test_naive_loop_is_extrapolated_from_two_fits(linear_models):
    linear, least = naive_minutes(SAMPLES, linear_models["gbm"], TWO_EPISODES)
    # Two parts at 800 samples take 2 s, at 1600 samples 2 s and a third of the 4 s to 3200.
    assert linear == pytest.approx(12 * (2 + 2 + 4 / 3) / 60)
    assert least == pytest.approx(12 * (2 + 2) / 60)


def test_study_and_naive_loop_are_summed(linear_models, tmp_path):
    for kind, minutes in {"gbm": 0.2, "ebm": 0.3, "symbolic": 0.5}.items():
        write_record(tmp_path / kind / "record.json", {"minutes": minutes})
    table = study_against_naive_loop(SAMPLES, TWO_EPISODES, tmp_path)
    assert table["student"].tolist() == ["gbm", "ebm", "all 3"]
    assert table["study (min)"].tolist() == [0.2, 0.3, 1.0]
    naive = 12 * (2 + 2 + 4 / 3) / 60
    assert table["ratio"].tolist() == pytest.approx([naive / 0.2, naive / 0.3, 2 * naive], abs=0.05)
    assert study_against_naive_loop(SAMPLES, TWO_EPISODES, tmp_path / "none").empty


def policies(gait="trot", *kinds):
    """Returns the shipped policies of a gait, of its students some kinds alone."""
    found = find_policies(load_gait(gait), quiet=True)
    return replace(found, files={kind: found.files[kind] for kind in kinds})


@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")
def test_controllers_in_c_are_timed_part_by_part():
    found = policies("trot", "sparse_formula")
    table = controllers.controller_times(found, count=1000).set_index("policy")
    assert table.index.tolist() == ["expert", "sparse_formula"]
    assert (table > 0).all(axis=None)
    assert table["policy (µs)"]["sparse_formula"] < table["policy (µs)"]["expert"]
    assert (table["step (µs)"] > table["estimator (µs)"]).all()
    assert (table["policy, 99.9 % (µs)"] > 0.5 * table["policy (µs)"]).all()
    assert table["C file (kB)"]["sparse_formula"] < table["C file (kB)"]["expert"]


@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")
@pytest.mark.slow
def test_controllers_of_several_gaits_are_timed_as_a_whole():
    several = [policies("walk"), policies("trot")]
    (row,) = controllers.switching_times(several, count=1000).to_dict("records")
    assert row["policy"] == "expert"
    assert 0 < row["step (µs)"] < row["step, 99.9 % (µs)"]
    assert row["C file (kB)"] > row["object file (kB)"] > 100
    assert "estimator (µs)" not in row


def test_of_several_repetitions_the_quietest_is_reported():
    drawn = iter([5.0, 2.0, 3.0, 4.0, 6.0])
    (times,), load = fastest(lambda: [Times(own := next(drawn), 10.0 * own)])
    assert times == Times(2.0, 20.0)
    assert load >= 0.0


def test_calls_are_timed_row_by_row():
    rows, seen = np.arange(6.0).reshape(3, 2), []
    times = call_times(lambda row: seen.append(row[0]), rows, 7)
    assert seen == [0, 2, 4, 0, 2, 4, 0]
    assert 0.0 < times.median < 1e6


def test_the_same_policies_are_timed_elsewhere(learned_expert, monkeypatch, capsys):
    monkeypatch.setattr(python_times, "N_STEPS", 3)
    found = policies()
    if find_spec("onnxruntime"):
        table = python_times.peer_times(found, count=40).set_index("policy")
        # Odometry is no part of a graph.
        assert table["policy, ONNX (µs)"]["expert"] > 0
        assert "both, ONNX (µs)" not in table.columns
        learned = replace(found, expert_there=learned_expert)
        table = python_times.peer_times(learned, count=40).set_index("policy")
        assert table["both, ONNX (µs)"]["expert"] > 0
        assert "policy, ONNX (µs)" not in table.columns
        assert table["both, Python (µs)"]["expert"] > table["policy, Python (µs)"]["expert"] > 0
    monkeypatch.setitem(sys.modules, "glassgait.models.export.graphs.runtime", None)
    table = python_times.peer_times(found, count=40).set_index("policy")
    assert table.index.tolist() == ["expert"]
    assert table["both, Python (µs)"]["expert"] > table["policy, Python (µs)"]["expert"] > 0
    assert not any("ONNX" in title for title in table.columns)
    assert "pip install 'glassgait[onnx]'" in capsys.readouterr().out


def test_parts_are_measured_as_asked(tmp_path, monkeypatch):
    table = pd.DataFrame({"policy": ["sparse_formula"], "step (µs)": [1.0]})
    for name in ("controller_times", "peer_times"):
        monkeypatch.setattr(command, name, lambda found: table)
    monkeypatch.setattr(command, "has_compiler", lambda: True)
    parts = ["--parts", "controllers", "inference"]
    main(["reproduce", "benchmark", *parts, "--output", str(tmp_path / "run")])
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert set(metrics) == {"controllers", "peers", "inference", "peak_memory_mb"}
    assert metrics["inference"][0]["policy"] == "Neural expert"
    assert (tmp_path / "run" / "peers.csv").exists()
