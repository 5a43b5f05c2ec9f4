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
from glassgait.studies.common.episode import give
from glassgait.studies.common.experiment import Experiment, Report, run_from_command_line
from glassgait.studies.common.scores import interval

STANDS = 0.1
"""Speed below which a robot stands (m/s)."""

WALKS, STOPS = 150, 100
"""Control steps of walking, and of standing after."""


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
        """Lets robots walk and then stand, and returns a row a robot."""
        n, dwell = self.n_robots, np.full(self.n_robots, float(case.gait.dwell[0]))
        walk, stand = (Command(np.tile([own, 0.0], (n, 1)), dwell) for own in (self.speed, 0.0))
        found = case.roll_out(n, WALKS + STOPS, events=[give(0, walk), give(WALKS, stand)])
        moves = np.abs(found.velocity[WALKS:, :, 0]) >= STANDS
        last = len(moves) - moves[::-1].argmax(axis=0)
        seconds = CONTROL_PERIOD * np.where(moves.any(axis=0), last, 0)
        fell = found.failures.any(axis=(0, 2))
        # A robot that moves at the end does not stand within the time, and a fallen one not at all.
        stands = ~moves[-1] & ~fell
        return pd.DataFrame({"seconds": np.where(stands, seconds, np.nan), "fell": fell})

    def report(self, table: pd.DataFrame) -> Report:
        """Reports falls, robots that stand, their mean time, and half of its 95 % interval."""
        groups = table.groupby(["gait", "policy", "scenario"], sort=False)
        means = groups.agg(
            robots=("fell", "size"),
            falls=("fell", "sum"),
            stand=("seconds", "count"),
            mean=("seconds", "mean"),
            interval=("seconds", interval),
        ).reset_index()
        return Report(tables={"stopping": means}, shown={"time to stand (s)": means})


if __name__ == "__main__":
    run_from_command_line(Stopping)
