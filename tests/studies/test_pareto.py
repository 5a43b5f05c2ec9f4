"""The front of size against reward."""

import numpy as np
import pandas as pd
import pytest

from glassgait.models.policies.library import load_expert
from glassgait.models.task.observation import machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.pareto.command import mean_nodes, pareto_table, smallest_that_walk
from glassgait.studies.pareto.formulas import FAMILIES
from glassgait.studies.students.dataset import Dataset

NAMES = load_expert("trot").observation_names


@pytest.fixture(scope="module")
def samples():
    generator = np.random.default_rng(0)
    observations = generator.normal(size=(600, len(NAMES)))
    state = generator.integers(2, size=600)
    observations[:, machine_state_entries(NAMES)] = np.eye(2)[state]
    actions = np.where(state == 0, 1.0, -1.0)[:, None] * observations[:, 2:14]
    return Dataset(observations, actions, np.repeat(np.arange(1, 11), 60))


@pytest.mark.parametrize("family", FAMILIES)
def test_lengths_bound_the_formulas(family, samples):
    sizes = [mean_nodes(FAMILIES[family].fit("trot", NAMES, samples, n)) for n in (2, 8, 24)]
    states = 2 if FAMILIES[family].statewise else 1
    assert sizes == sorted(sizes)
    assert all(size <= n * states for size, n in zip(sizes, (2, 8, 24), strict=True))


def test_the_smallest_that_walk_are_named():
    fits = pd.DataFrame(
        {
            "policy": ["a", "b", "c"],
            "family": ["gated", "linear", "linear"],
            "nodes": [30.0, 12.0, 1.0],
            "r2": 0.9,
        }
    )
    scores = pd.DataFrame(
        {"policy": ["expert", "a", "a", "b", "b", "c"], "reward": [10, 9, 9, 8, 4, 1]}
    )
    for name in ("plain_reward", "rhythm", "speed_error", "yaw_rate_error", "cost_of_transport"):
        scores[name] = 1.0
    scores["fell"] = [False, False, False, False, True, False]
    scores.loc[5, "rhythm"] = 0.0
    front = pareto_table(fits, scores)
    assert front["policy"].tolist() == ["c", "b", "a"]
    assert front["share"].tolist() == pytest.approx([0.1, 0.6, 0.9])
    smallest = smallest_that_walk(front)
    assert smallest["share asked for"].tolist() == [0.0, 0.9]
    assert smallest["formulas"].tolist() == ["gated sum", "gated sum"]
    assert smallest["nodes"].tolist() == [30.0, 30.0]
    none = smallest_that_walk(front[front["falls"] > 0])
    assert none.empty and list(none.columns) == list(smallest.columns)


def test_command_writes_table_figure_and_formulas(samples, tmp_path, capsys):
    samples.save(tmp_path / "rounds" / "round_1.safetensors")
    small = ["--lengths", "2", "6", "--n-robots", "2", "--n-steps", "20"]
    output = tmp_path / "pareto"
    main(["pareto", *small, "--samples", str(tmp_path / "rounds"), "--output", str(output)])
    assert {path.name for path in output.glob("pareto.*")} == {
        "pareto.csv", "pareto.md", "pareto.png", "pareto.pdf",
    }  # fmt: skip
    assert (output / "smallest.csv").exists()
    assert len(list((output / "formulas").iterdir())) == 8
    assert "written to" in capsys.readouterr().out


def test_missing_samples_are_told(tmp_path, refused):
    assert "holds no samples" in refused(["pareto", "--samples", str(tmp_path)])
