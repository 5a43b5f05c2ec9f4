"""The benchmark times what it says it times."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

import studies.benchmark.distillation
from models.policies.library import load_expert
from studies.benchmark.distillation import (
    NAIVE_MODELS,
    compiled_against_library,
    expert_samples,
    naive_minutes,
)
from studies.benchmark.inference import single_row_microseconds
from studies.benchmark.throughput import training_and_physics
from studies.distillation.collection import Dataset
from studies.distillation.config import (
    DistillationConfig,
    EbmConfig,
    GbmConfig,
    HistogramGbmConfig,
)
from studies.training.config import PpoConfig, TrainingConfig


def test_training_and_physics_are_timed_over_the_same_steps():
    config = TrainingConfig(
        n_robots=4, n_groups=1, payloads=(), fine_steps=(), ppo=PpoConfig(steps_per_update=8)
    )
    rows = training_and_physics(config, None, n_updates=1, repeats=2)
    assert len(rows) == 2
    assert all(row["physics"] > row["training"] > 0 for row in rows)


def test_single_row_time_counts_calls():
    calls = []
    assert single_row_microseconds(calls.append, np.zeros(3)) >= 0
    assert len(calls) == 320


def test_compiled_students_are_timed_beside_the_libraries_that_they_equal():
    expert = load_expert("trot")
    samples = expert_samples(expert, n_steps=40)
    config = DistillationConfig(
        gbm=GbmConfig(n_trees=5),
        histogram_gbm=HistogramGbmConfig(n_trees=5),
        ebm=EbmConfig(interactions=2, max_rounds=5),
        n_jobs=1,
    )
    table = compiled_against_library(samples, expert.observation_names, config)
    assert table["student"].tolist() == ["gbm", "histogram_gbm", "ebm"]
    assert (table["greatest difference"] < 1e-9).all()
    assert (table[["compiled (µs)", "predict × 12 (µs)"]] > 0).all(axis=None)


def test_naive_loop_is_extrapolated_from_two_fits(monkeypatch):
    clock = iter([0.0, 1.0, 10.0, 13.0])
    monkeypatch.setattr(studies.benchmark.distillation.time, "perf_counter", lambda: next(clock))
    monkeypatch.setitem(NAIVE_MODELS, "gbm", LinearRegression)
    samples = Dataset(np.zeros((3000, 4)), np.zeros((3000, 12)), np.ones(3000, dtype=np.int64))
    config = DistillationConfig(episodes=2, episode_steps=1000)
    # A second for 800 samples and three for 2400 make 3 s for 2 episodes of 800 and 1600 in all.
    assert naive_minutes(samples, "gbm", config) == pytest.approx(12 * 3 / 60)
