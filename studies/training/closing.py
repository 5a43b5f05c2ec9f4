"""The end of a run that makes policies: a first score in closed loop, and how to see them walk."""

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

FEW = RolloutConfig(n_robots=8, n_steps=round(5.0 / CONTROL_PERIOD), seed=0, n_seeds=1)
"""Few robots, of a seed that neither selects nor is reported."""


def show_result(gait: str, folder: Path, robot: str) -> None:
    """Lets every policy of a run walk for a moment, and prints falls, returns and a command."""
    found = find_policies(load_gait(gait), folder, robot, quiet=True)
    rows = []
    for policy, controller in found.controllers([ALL]).items():
        scores = score(found.gait, controller, Scenario(), FEW)
        earned = round(float(scores["return"].mean()), 1)
        rows.append({"policy": policy, "falls of 8": scores["fell"].sum(), "return": earned})
    title = f"{found.gait.name}: {FEW.n_steps * CONTROL_PERIOD:g} s, nominal scenario"
    print_table(title, pd.DataFrame(rows))
    best = max(rows[1:] or rows, key=lambda row: row["return"])
    of = f"--gait {quote(gait)}{found.robot.option} --source {quote(str(folder))}"
    # Not wrapped, so that they can be copied.
    console.print(f"watch: glassgait view {of} --policy {best['policy']}", soft_wrap=True)
    console.print(f"score: glassgait evaluate scenarios {of}", soft_wrap=True)
