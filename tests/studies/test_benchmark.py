"""The benchmark times what it says it times."""

import json

import pandas as pd
import pytest

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.export.binding import has_compiler
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.policies import find_policies
from glassgait.studies.reproduction import benchmark
from glassgait.studies.training.config import PpoConfig, TrainingConfig


@pytest.mark.slow
def test_training_is_timed():
    config = TrainingConfig(
        n_robots=4,
        worlds=DomainRandomization(n_groups=1, fine_steps=()),
        ppo=PpoConfig(steps_per_update=8),
    )
    (rate,) = benchmark.throughput(config, n_updates=1, repeats=3)["control steps/s"]
    assert rate > 0


@pytest.mark.slow
@pytest.mark.skipif(not has_compiler(), reason="needs a C compiler, cc")
def test_actions_are_timed_in_python_and_in_c():
    table = benchmark.action_times(find_policies(load_gait("trot")), steps=2000)
    times = table[["action in Python (µs)", "step in C (µs)", "step in C, 99.9 % (µs)"]]
    assert (times > 0).all(axis=None)


def test_both_parts_are_written(tmp_path, monkeypatch):
    table = pd.DataFrame({"policy": ["expert"], "action in Python (µs)": [1.0]})
    for part in ("throughput", "action_times"):
        monkeypatch.setattr(benchmark, part, lambda *given: table)
    folder = tmp_path / "run"
    main(["reproduce", "benchmark", "--output", str(folder)])
    assert set(json.loads((folder / "metrics.json").read_text())) == {"throughput", "actions"}
    assert (folder / "actions.csv").exists()
