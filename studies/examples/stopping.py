"""Custom experiment: how long a walking robot takes to stand. `--help` lists settings."""

import pandas as pd

from glassgait.diagrams import FixedCommand
from glassgait.models.settings import checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.episode import give
from glassgait.studies.common.experiment import Case, Experiment, Report, run_from_command_line
from glassgait.studies.common.rollouts import RolloutConfig, roll_out


@checked
class Stopping(Experiment):
    """Let robots walk for 3 s, then command 0 m/s for 2 s; robots below 0.1 m/s stand."""

    title = "stopping"
    speed: float = 0.5  # Commanded forward speed while they walk (m/s).

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls out the robots of a case, and returns one row per robot."""
        walk, stand = (FixedCommand(speed, dwell=case.gait.dwell[0]) for speed in (self.speed, 0.0))
        config = RolloutConfig(self.n_robots, 250, case.seed)
        events = [give(0, walk), give(150, stand)]
        log = roll_out(case.gait, case.controller, case.scenario, config, events=events)
        fell = log.failures.any(axis=(0, 2))
        moves = (pd.DataFrame(log.velocity[150:, :, 0]).abs() >= 0.1)[::-1].cummax().sum()
        seconds = CONTROL_PERIOD * moves.mask(fell | (moves == 100))
        return pd.DataFrame({"robots": 1, "falls": fell, "stand": seconds.notna(), "mean": seconds})

    def report(self, table: pd.DataFrame) -> Report:
        """Counts robots, falls and robots that stand, and averages their times to stand."""
        groups = table.groupby(["gait", "policy", "scenario"], sort=False, as_index=False)
        means = groups.agg({"robots": "sum", "falls": "sum", "stand": "sum", "mean": "mean"})
        return Report({"stopping": means}, shown={"Mean time to stand (s)": means})


if __name__ == "__main__":
    run_from_command_line(Stopping)
