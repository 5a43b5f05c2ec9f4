"""Pushing robots: who survives what, how that is reported, and the command."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import alone
from glassgait.models.task.gait import load_gait
from glassgait.models.task.termination import PHYSICAL_FALL
from glassgait.studies.cli import main
from glassgait.studies.evaluation.pushing import (
    Basin,
    Pushed,
    PushGrid,
    horizontal,
    push_everywhere,
)

TROT = load_gait("trot")
WORLD = Scenario(command=FixedCommand(0.5, 0.0, 8))
GRID = PushGrid(np.array([0.0, np.pi / 2, np.pi]), np.array([0.2, 8.0]), 2)


def pushed(policy, seed=3, world=WORLD, grid=GRID):
    return push_everywhere(TROT, policy, world, grid, n_steps=60, seed=seed)


@pytest.fixture(scope="module")
def by_expert(expert):
    return pushed(alone(expert))


def test_a_light_push_is_survived_and_a_train_is_not(by_expert):
    assert by_expert.survived.shape == GRID.shape == (3, 2, 2)
    assert by_expert.survived[:, 0].all() and not by_expert.survived[:, 1].any()
    assert (by_expert.failure[:, 0] == -1).all() and (by_expert.failure[:, 1] >= 0).all()
    counts = by_expert.failure_counts()
    assert sum(counts.values()) == 6 and counts["no_rhythm"] == 0


def test_what_ends_by_a_high_foot_alone_is_no_physical_fall(expert):
    grid = PushGrid(np.linspace(0.0, 2 * np.pi, 6, endpoint=False), np.array([2.0, 8.0]), 2)
    low = replace(WORLD.limits, foot_height=0.15)
    task, physical = (
        pushed(alone(expert), world=replace(WORLD, limits=limits), grid=grid)
        for limits in (low, PHYSICAL_FALL)
    )
    assert (physical.survived >= task.survived).all()
    assert physical.survived[:, 0].sum() > task.survived[:, 0].sum()
    assert not physical.survived[:, 1].all()
    counts = physical.failure_counts()
    assert counts["high_foot"] == counts["low_trunk"] == counts["abrupt_action"] == 0
    assert counts["body_contact"] + counts["lean"] > 0


def test_a_policy_that_stands_does_not_walk(other_expert):
    still = pushed(alone(other_expert))
    assert not still.survived.any()
    counts = still.failure_counts()
    assert counts.pop("no_rhythm") == 12 and not any(counts.values())


def test_a_robot_is_pushed_where_it_faces(standing):
    plant = np.tile(standing, (3, 1))
    plant[:, :4] = [np.cos(0.5), 0.0, 0.0, np.sin(0.5)]
    ahead, left = np.array([np.cos(1.0), np.sin(1.0)]), np.array([-np.sin(1.0), np.cos(1.0)])
    pushes = horizontal(plant, np.array([0.0, np.pi / 2, np.pi]), np.array([0.2, 0.2, 8.0]))
    np.testing.assert_allclose(pushes[:, :2], [0.2 * ahead, 0.2 * left, -8.0 * ahead], atol=1e-12)
    assert (pushes[:, 2] == 0.0).all()


def basin(survived, n_phases=4):
    survived = np.array(survived)
    directions = 2 * np.pi * np.arange(len(survived)) / len(survived)
    grid = PushGrid(directions, np.arange(1.0, 1.0 + survived.shape[1]), n_phases)
    return Basin(grid, survived, {"low_trunk": 3, "high_foot": 0})


def test_one_direction_that_fails_ends_what_all_survive():
    own = basin([[4, 4, 4, 0], [4, 4, 3, 0], [4, 4, 4, 4]])
    assert own.survived_up_to(1.0) == 2.0 and own.survived_up_to(0.5) == 3.0
    # What is survived beyond a failure does not count.
    gap = basin([[4, 0, 4], [4, 0, 4], [4, 4, 4]])
    assert gap.survived_up_to(1.0) == gap.survived_up_to(0.5) == 1.0
    assert basin([[3, 4], [4, 4], [4, 4]]).survived_up_to(1.0) == 0.0
    assert basin(np.full((3, 2), 4)).survived_up_to(1.0) == 2.0


def test_command_writes_tables_and_a_picture(tmp_path, monkeypatch):
    def quickly(gait, policy, scenario, grid, *, n_steps, seed):
        assert n_steps == 50 and scenario.command == FixedCommand(0.3)
        draws = np.random.default_rng([seed, policy.period]).random(grid.shape)
        survived = draws > grid.speeds[:, None] / 10.0
        return Pushed(survived, np.where(survived, -1, 0))

    monkeypatch.setattr("glassgait.studies.evaluation.pushing.push_everywhere", quickly)
    small = ["--n-directions", "4", "--speeds", "0.1", "8", "--n-phases", "3", "--n-steps", "50"]
    named = ["--policy", "expert", "formulas", "--command.speed", "0.3"]
    main(["evaluate", "pushes", *small, *named, "--output", str(tmp_path)])
    table = pd.read_csv(tmp_path / "summary.csv")
    assert table["policy"].tolist() == ["expert", "formulas"]
    whole = pd.read_csv(tmp_path / "pushes.csv")
    assert len(whole) == 2 * 4 * 2 and (whole["robots"] == 3).all()
    share = whole.groupby("policy", sort=False)["survived"].sum() / 24
    assert table["share"].tolist() == pytest.approx(share.tolist())
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert [row["survived"] for row in metrics] == table["survived"].tolist()
    assert (tmp_path / "pushes.png").exists()


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [(["--speeds", "2", "1"], "name the least first"), (["--command.speed", "3"], "speed is 3")],
)
def test_pushes_that_cannot_be_are_refused(arguments, reported, refused, tmp_path):
    folder = tmp_path / "run"
    assert reported in refused(["evaluate", "pushes", *arguments, "--output", str(folder)])
    assert not folder.exists()
