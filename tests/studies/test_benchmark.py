"""The benchmark times what it says it times."""

import numpy as np

from studies.benchmark.inference import single_row_microseconds
from studies.benchmark.throughput import training_and_physics
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
