"""Robots' days: what is rolled out, how it is scored, and the command."""

import json

import numpy as np
import pandas as pd
import pytest

from glassgait.models.task.day import load_day
from glassgait.studies.cli import main
from glassgait.studies.evaluation.day import day_table
from glassgait.studies.evaluation.day_rollouts import _movement

DAY = load_day()


def robot(**values):
    own = {"gait": "trot", "policy": "expert", "scenario": "training", "push": 0.0, "robot": 0}
    own |= {"fell": False, "fell_in": "", "risen": 2.5, "standing": 1.0, "foot_movement": 1.0}
    own |= {"torque_rise": 3.0, "torque_walk": 20.0, "leaned": 5.0, "damped": False}
    return own | {"end": "rest", "end_height": 0.06, "end_lean": 0.0} | values


def test_falls_are_counted_by_mode_and_leans_beside_what_was_damped():
    rows = [robot(), robot(fell=True, fell_in="walk", leaned=80.0, damped=True, end="damped")]
    rows += [robot(fell=True, fell_in="walk"), robot(fell=True, fell_in="rise")]
    (found,) = day_table(pd.DataFrame(rows), DAY).to_dict("records")
    assert (found["robots"], found["falls"]) == (4, 3)
    assert found["fell_in"] == "walk 2, rise 1"
    assert (found["over"], found["over_damped"], found["lying"]) == (1, 1, 3)
    assert found["torque"] == 20.0


def test_a_foots_movement_counts_from_the_begin_of_each_stay():
    feet = np.zeros((6, 4, 2))
    feet[:, 0, 0] = [0.0, 0.0, 0.003, 1.0, 1.0, 1.002]
    still = np.array([False, True, True, False, True, True])
    assert _movement(feet, still) == pytest.approx(0.003)


@pytest.mark.slow
def test_the_command_lets_robots_live_through_a_day(tmp_path):
    few = ["--n-robots", "1", "--n-seeds", "1", "--scenario", "mujoco", "--pushes", "0"]
    main(["evaluate", "day", *few, "--output", str(tmp_path)])
    (found,) = json.loads((tmp_path / "metrics.json").read_text())
    assert (found["robots"], found["falls"], found["lying"]) == (1, 0, 1)
