"""Robots whose controller falls silent for good: at many moments none overturns."""

import json
from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.link.watchdog import Watchdog
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.deployment.drive import dropout as silence
from glassgait.studies.deployment.drive.dropout import (
    Left,
    lower,
    pushed,
    silence_table,
    walk_until_silent,
)

A1 = load_robot()


@pytest.mark.parametrize(
    ("name", "by_page"), [("trot", True), pytest.param("bound", False, marks=pytest.mark.slow)]
)
def test_no_robot_overturns_whenever_its_controller_vanishes(name, by_page, monkeypatch):
    """Of the bound this holds of its network: with its page one of 192 overturns."""
    monkeypatch.setattr(silence, "SETTLED", 60)
    gait = load_gait(name)
    expert = load_expert(gait)
    controller = alone(load_student(name, "sparse_formula"), expert) if by_page else alone(expert)
    left = walk_until_silent(gait, controller, Scenario(), n_moments=8, seed=0)
    assert left.walked.all()
    # They were caught in the middle of their strides: some on two feet, and moving.
    feet = kinematics.foot_heights(A1, left.states)
    assert np.any(np.sum(feet < 0.0, axis=1) <= 2)
    lowered = lower(A1, left, StationConfig(), Watchdog(), n_steps=70)
    assert lowered.greatest.max() < 45.0
    assert lowered.final.max() < 10.0


def standing(n):
    states = np.tile(kinematics.standing_state(A1), (n, 1))
    targets = np.tile(A1.default_stance, (n, 1))
    return Left(np.array([0.5, 0.5, 1.0])[:n], states, targets, np.array([True, True, False])[:n])


def test_a_robot_on_its_back_is_counted():
    left = standing(3)
    left.states[0, quadruped.QUATERNION] = 0.0, 1.0, 0.0, 0.0
    left.states[0, quadruped.POSITION] = 0.0, 0.0, 0.3
    table = silence_table(left, lower(A1, left, StationConfig(), Watchdog(), n_steps=5))
    assert table["robots"].tolist() == [2, 0]
    assert table["overturned"].tolist() == [1, 0]
    assert table["greatest lean (°)"][0] == pytest.approx(180.0, abs=1.0)


def test_pushes_are_horizontal_and_of_the_speed_that_was_asked_for():
    left = standing(3)
    velocity = pushed(left, 1.5, seed=3).states[:, quadruped.LINEAR_VELOCITY]
    np.testing.assert_allclose(np.linalg.norm(velocity[:, :2], axis=1), 1.5)
    np.testing.assert_array_equal(velocity[:, 2], 0.0)
    assert len(np.unique(velocity[:, 0])) == 3
    np.testing.assert_array_equal(left.states[:, quadruped.LINEAR_VELOCITY], 0.0)


def test_a_standing_robot_is_lowered_to_the_crouch():
    left = standing(1)
    settings = replace(Watchdog(), lowering=0.1)
    lowered = lower(A1, left, StationConfig(), settings, n_steps=30)
    assert lowered.greatest[0] < 10.0
    assert 0.1 < lowered.descent[0] < 2.0


def test_the_command_counts_and_writes_its_table(tmp_path, monkeypatch):
    monkeypatch.setattr(silence, "SETTLED", 5)
    run = ["drive", "dropout", "--policy", "sparse_formula", "--n-moments", "1", "--n-steps", "10"]
    main([*run, "--output", str(tmp_path / "run")])
    rows = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert [row["speed (m/s)"] for row in rows] == [0.25, 0.5, 0.75]
    assert all(row["robots"] == 1 for row in rows)
    assert (tmp_path / "run" / "silence.md").exists()
