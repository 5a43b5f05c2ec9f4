"""Counterfactuals: the nearest value of each observation at which a target passes a level."""

import numpy as np
import pandas as pd
import pytest

from glassgait.models.certificates.box import operating_box
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import symbols_of
from glassgait.studies.cli import main
from glassgait.studies.explanation.counterfactual import Scan

A1, TROT = load_robot(), load_gait("trot")
BOX = operating_box(TROT, A1)
SYMBOLS = symbols_of(BOX.names)
JOINT = quadruped.joint_index("FR_calf")


@pytest.mark.parametrize(
    "kind", ["expert", "linear_per_state", "formulas", pytest.param("gbm", marks=pytest.mark.slow)]
)
def test_each_value_is_the_nearest_that_passes_the_level(kind):
    policy = load_expert("trot") if kind == "expert" else load_student("trot", kind)
    quantities = BOX.in_state(0).random(1, np.random.default_rng(1))[0]
    units = Scan(policy, JOINT, np.zeros(len(SYMBOLS)), BOX)._units
    scan = Scan(policy, JOINT, units.observed(quantities), BOX)
    level = scan.target + 0.05
    table = scan.passes(level)
    assert len(table) and table["share of range"].is_monotonic_increasing

    def target(symbol, value):
        other = quantities.copy()
        other[SYMBOLS.index(symbol)] = value
        return A1.joint_targets(policy(units.observed(other)))[JOINT]

    for row in table.to_dict("records"):
        symbol, value, here = row["observation"], row["passes at"], row["value"]
        low, high = BOX.ranges[symbol]
        assert target(symbol, value) == pytest.approx(row["target (rad)"]) and low <= value <= high
        assert row["target (rad)"] > level
        if symbol not in ("t", "cmd.t"):
            # On the way there the level is not passed.
            for share in (0.3, 0.6, 0.9, 1.0 - 1e-6):
                assert target(symbol, here + share * (value - here)) <= level + 1e-4


@pytest.mark.slow
def test_the_command_writes_a_table_and_a_figure(tmp_path):
    place = ["--step", "20", "--output", str(tmp_path / "out")]
    main(["explain", "counterfactual", "--gait", "trot", "--policy", "ebm", *place])
    table = pd.read_csv(tmp_path / "out" / "counterfactual.csv")
    assert (table["target (rad)"].diff().abs() < 1.0)[1:].all() and len(table)
    assert (tmp_path / "out" / "counterfactual.md").exists()
    assert (tmp_path / "out" / "counterfactual.png").stat().st_size > 10_000
