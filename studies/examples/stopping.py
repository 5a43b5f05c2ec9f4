"""An experiment of one's own: how long a walking robot takes to stand when it is commanded to.

    python stopping.py --policy expert sparse_formula --n-robots 8

`python stopping.py --help` lists all settings. It runs side by side, keeps what is done, and
`--resume` continues it.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd

from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report, run_from_command_line
from glassgait.studies.common.rollouts.roll_out import log_policy, make_batch
from glassgait.studies.common.rollouts.scores import interval

STANDS = 0.1
"""Speed below which a robot stands (m/s)."""


@dataclass(frozen=True)
class Stopping(Experiment):
    """Measure how long robots take to stand.

    Attributes:
        speed: Commanded forward speed before (m/s).
    """

    title: ClassVar[str] = "stopping"
    discrete: ClassVar[bool] = True
    speed: float = 0.5

    def measure(self, case: Case) -> pd.DataFrame:
        """Lets robots walk for 3 s and stand for 2 s, and returns a row a robot."""
        n, dwell = self.n_robots, np.full(self.n_robots, float(case.gait.dwell[0]))
        robots = make_batch(case.gait, case.controller, case.scenario, n_robots=n, seed=case.seed)
        robots.set_command(Command(np.tile([self.speed, 0.0], (n, 1)), dwell))
        log_policy(robots, case.controller, 150)
        robots.set_command(Command(np.zeros((n, 2)), dwell))
        log = log_policy(robots, case.controller, 100)
        moves = np.abs(log.velocity[..., 0]) >= STANDS
        last = len(moves) - moves[::-1].argmax(axis=0)
        seconds = CONTROL_PERIOD * np.where(moves.any(axis=0), last, 0)
        return pd.DataFrame({"seconds": seconds, "fell": log.failures.any(axis=(0, 2))})

    def report(self, table: pd.DataFrame) -> Report:
        """Reports means with 95 % intervals, and falls."""
        groups = table.groupby(["gait", "policy", "scenario"], sort=False)
        means = groups.agg(
            robots=("fell", "size"),
            falls=("fell", "sum"),
            seconds=("seconds", "mean"),
            seconds_ci=("seconds", interval),
        ).reset_index()
        return Report(tables={"stopping": means}, shown={"time to stand (s)": means})


if __name__ == "__main__":
    run_from_command_line(Stopping)
