"""Pushing robots: who survives what, how that is reported, and the command."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import alone
from glassgait.models.policies.function import FunctionPolicy
from glassgait.models.task.gait import load_gait
from glassgait.models.task.termination import PHYSICAL_FALL
from glassgait.studies.cli import main
from glassgait.studies.evaluation.pushing import horizontal, push_everywhere
from glassgait.studies.evaluation.tables import push_summary

TROT = load_gait("trot")
WORLD = Scenario(command=FixedCommand(0.5, 0.0, 8))
GRID = {"n_directions": 4, "speeds": (0.2, 8.0), "n_phases": 2}


def pushed(policy, world=WORLD, gait=TROT, **grid):
    return push_everywhere(gait, policy, world, **{**GRID, **grid}, n_steps=60, seed=3)


def test_a_light_push_is_survived_and_a_train_is_not(expert):
    table = pushed(alone(expert))
    assert len(table) == 16
    assert (table["survived"] == (table["speed (m/s)"] == 0.2)).all()
    assert ((table["end"] == "") == table["survived"]).all()
    assert "no_rhythm" not in set(table["end"])


def test_what_ends_by_a_high_foot_alone_is_no_physical_fall(expert):
    low = replace(WORLD.limits, foot_height=0.15)
    task, physical = (
        pushed(alone(expert), replace(WORLD, limits=limits), n_directions=6, speeds=(2.0, 8.0))
        for limits in (low, PHYSICAL_FALL)
    )
    assert (physical["survived"] >= task["survived"]).all()
    light = task["speed (m/s)"] == 2.0
    assert physical["survived"][light].sum() > task["survived"][light].sum()
    ends = set(physical["end"][~light]) - {""}
    assert ends & {"body_contact", "lean"}
    assert not ends & {"high_foot", "low_trunk", "abrupt_action"}


def test_a_policy_that_stands_does_not_walk(other_expert):
    assert set(pushed(alone(other_expert))["end"]) == {"no_rhythm"}


def test_without_a_rhythm_robots_survive_that_do_not_fall_and_remember_their_frames():
    class Standing(FunctionPolicy):
        @property
        def n_memory(self):
            return 1  # the number of control steps

        def remember(self, memory, observation):
            counts.append(np.nan_to_num(memory + 1.0))
            return counts[-1]

        def act(self, observation):
            return np.zeros((len(observation), 12))

    counts = []
    table = pushed(alone(Standing(np.zeros_like, "free")), gait=load_gait("free"))
    assert (table["survived"] == (table["speed (m/s)"] == 0.2)).all()
    # The second of two phases is half a stride after the first.
    first = next(count for count in counts if len(count) == len(table))
    assert {*first.ravel()} == {176.0, 188.0}


def test_a_robot_is_pushed_where_it_faces(standing):
    plant = np.tile(standing, (3, 1))
    plant[:, :4] = [np.cos(0.5), 0.0, 0.0, np.sin(0.5)]
    ahead, left = np.array([np.cos(1.0), np.sin(1.0)]), np.array([-np.sin(1.0), np.cos(1.0)])
    pushes = horizontal(plant, np.array([0.0, np.pi / 2, np.pi]), np.array([0.2, 0.2, 8.0]))
    np.testing.assert_allclose(pushes[:, :2], [0.2 * ahead, 0.2 * left, -8.0 * ahead], atol=1e-12)
    assert (pushes[:, 2] == 0.0).all()


def summary(survived):
    """Sums up how many of 4 robots survive, by direction and speed (1, 2, … m/s)."""
    rows = [
        ("a", 90.0 * i, 1.0 + j, robot < count, "" if robot < count else "lean")
        for i, counts in enumerate(survived)
        for j, count in enumerate(counts)
        for robot in range(4)
    ]
    columns = ["policy", "direction (°)", "speed (m/s)", "survived", "end"]
    return push_summary(pd.DataFrame(rows, columns=columns)).iloc[0]


@pytest.mark.parametrize(
    ("survived", "all_up_to", "half_up_to"),
    [
        ([[4, 4, 4, 0], [4, 4, 3, 0], [4, 4, 4, 4]], 2.0, 3.0),
        # What is survived beyond a failure does not count.
        ([[4, 0, 4], [4, 0, 4], [4, 4, 4]], 1.0, 1.0),
        ([[3, 4], [4, 4], [4, 4]], 0.0, 2.0),
    ],
)
def test_one_direction_that_fails_ends_what_all_survive(survived, all_up_to, half_up_to):
    row = summary(survived)
    assert row["all survived up to (m/s)"] == all_up_to
    assert row["half survived up to (m/s)"] == half_up_to
    assert row["lean"] == row["pushes"] - row["survived"]
    assert row["weakest direction (°)"] == 90.0 * np.argmin(np.sum(survived, axis=1))


def test_command_writes_tables_and_a_picture(tmp_path, monkeypatch):
    def quickly(gait, policy, scenario, *, n_directions, speeds, n_phases, n_steps, seed):
        assert n_steps == 50 and scenario.command == FixedCommand(0.3)
        rows = list(product(90.0 * np.arange(n_directions), speeds, range(n_phases)))
        table = pd.DataFrame(rows, columns=["direction (°)", "speed (m/s)", "phase"])
        survived = table["speed (m/s)"] < 8.0 * policy.period
        return table.assign(survived=survived, end=np.where(survived, "", "lean"))

    monkeypatch.setattr("glassgait.studies.evaluation.pushing.push_everywhere", quickly)
    small = ["--n-directions", "4", "--speeds", "0.1", "8", "--n-phases", "3", "--n-steps", "50"]
    named = ["--policy", "expert", "formulas", "--command.speed", "0.3"]
    main(["evaluate", "pushes", *small, *named, "--output", str(tmp_path)])
    table = pd.read_csv(tmp_path / "summary.csv")
    assert table["policy"].tolist() == ["expert", "formulas"]
    whole = pd.read_csv(tmp_path / "pushes.csv")
    assert len(whole) == 2 * 4 * 2 and (whole["pushes"] == 3).all()
    assert (
        whole.groupby("policy")["survived"].sum() == table.set_index("policy")["survived"]
    ).all()
    assert (tmp_path / "metrics.json").exists() and (tmp_path / "pushes.png").exists()


def test_a_command_beyond_the_gaits_range_is_refused(refused, tmp_path):
    arguments = ["evaluate", "pushes", "--command.speed", "3", "--output", str(tmp_path / "run")]
    assert "d.speed is 3" in refused(arguments)
    assert not (tmp_path / "run").exists()
