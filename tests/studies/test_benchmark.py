"""The benchmark times what it says it times."""

import itertools

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from glassgait.diagrams.worlds import Worlds
from glassgait.models.files import write_record
from glassgait.models.policies.library import load_expert, load_student
from glassgait.studies.benchmark import controllers, distillation
from glassgait.studies.benchmark.distillation import (
    NaiveModel,
    compiled_against_library,
    expert_samples,
    naive_minutes,
    study_against_naive_loop,
)
from glassgait.studies.benchmark.inference import single_row_microseconds
from glassgait.studies.benchmark.throughput import training_and_physics
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.export.compiler import has_compiler
from glassgait.studies.students.additive import EbmSettings
from glassgait.studies.students.boosting import GbmSettings, HistogramGbmSettings
from glassgait.studies.students.dataset import Dataset
from glassgait.studies.students.settings import StudentsSettings
from glassgait.studies.training.config import PpoConfig, TrainingConfig


def test_training_and_physics_are_timed_over_the_same_steps():
    config = TrainingConfig(
        n_robots=4, worlds=Worlds(n_groups=1, fine_steps=()), ppo=PpoConfig(steps_per_update=8)
    )
    rows = training_and_physics(config, None, n_updates=1, repeats=3)
    assert len(rows) == 3
    # Other jobs of the machine slow one timing of a few milliseconds, seldom all.
    best = {name: max(row[name] for row in rows) for name in rows[0]}
    assert best["physics"] > best["training"] > 0
    assert best["late_physics"] > best["training"]


def test_single_row_time_counts_calls():
    calls = []
    assert single_row_microseconds(calls.append, np.zeros(3)) >= 0
    assert len(calls) == 320


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
    monkeypatch.setattr(distillation.time, "perf_counter", lambda: next(clock))
    models = {kind: NaiveModel(LinearRegression, 2, (800, 3200)) for kind in ("gbm", "ebm")}
    monkeypatch.setattr(distillation, "NAIVE_MODELS", models)
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


@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")
def test_controllers_in_c_are_timed_part_by_part(monkeypatch):
    kept = {"page": load_student("trot", "page")}
    monkeypatch.setattr(controllers, "load_shipped_students", lambda expert: kept)
    table = controllers.controller_times("trot", count=1000).set_index("policy")
    assert table.index.tolist() == ["expert", "page"]
    assert (table > 0).all(axis=None)
    assert table["policy (µs)"]["page"] < table["policy (µs)"]["expert"]
    assert (table["step (µs)"] > table["estimator (µs)"]).all()
    assert table["C file (kB)"]["page"] < table["C file (kB)"]["expert"]
