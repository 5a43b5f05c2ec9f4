"""Summary at the end of a run: a first score of its policies, and commands to view them."""

from pathlib import Path
from shlex import quote

import pandas as pd

from glassgait.diagrams.scenario import Scenario
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import ALL, find_policies
from glassgait.studies.common.rollouts import RolloutConfig, score
from glassgait.studies.common.tables import print_table

QUICK = RolloutConfig(n_robots=8, n_steps=round(5.0 / CONTROL_PERIOD), seed=0, n_seeds=1)
"""Settings of a quick score, with a seed that is neither for selection nor for reports."""


def show_result(gait: str, folder: Path, robot: str) -> None:
    """Scores every policy of a run for 5 s, and prints falls, return, rhythm and shell commands."""
    policies = find_policies(load_gait(gait), folder, robot, quiet=True)
    rows = []
    for policy, controller in policies.controllers([ALL]).items():
        scores = score(policies.gait, controller, Scenario(), QUICK)
        means = {key: round(float(scores[key].mean()), 2) for key in ("return", "rhythm")}
        rows.append({"policy": policy, "falls of 8": scores["fell"].sum(), **means})
    title = f"{policies.gait.name}: {QUICK.n_steps * CONTROL_PERIOD:g} s, nominal scenario"
    print_table(title, pd.DataFrame(rows))
    best = max(rows[1:] or rows, key=lambda row: row["return"])
    options = f"--gait {quote(gait)}{policies.robot.option} --source {quote(str(folder))}"
    # Long lines are not wrapped, so that a user can copy the commands.
    console.print(f"watch: glassgait view {options} --policy {best['policy']}", soft_wrap=True)
    console.print(f"score: glassgait evaluate scenarios {options}", soft_wrap=True)
