"""`glassgait evaluate stability`: whether small differences grow or fade from stride to stride."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Gt, Le, MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import TRAINING
from glassgait.models.settings import DISTINCT, FEW, Count
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.evaluation.stability_figures import stability_figure
from glassgait.studies.evaluation.stability_tables import (
    prediction_table,
    stability_table,
    summary_table,
)
from glassgait.studies.evaluation.stride_analysis import analyse
from glassgait.studies.evaluation.strides import StrideMap

SLOWEST = 0.25
"""Least speed by default (m/s)."""

StepSize = Annotated[float, Gt(0.0), Le(1.0)]


@dataclass(frozen=True)
class Stability(Experiment):
    """Find whether small differences grow or fade from one stride to the next, and test it.

    Attributes:
        speeds: Commanded forward speeds (m/s); by default three from 0.25 to the greatest of
            distillation.
        yaw_rates: Commanded yaw rates (rad/s).
        dwell: Commanded dwell of every speed and yaw rate (control steps).
        dwells: Further dwells at the middle speed and yaw rate; every one of the gait by default.
        n_strides: Strides that a gait has to settle, from standing.
        step_sizes: Sizes of the differences that the map is differentiated by, in units of what a
            gait sways (0.01 m, 0.05 rad, 0.1 m/s, …); their spread shows the error.
    """

    title: ClassVar[str] = "evaluate stability"
    scenario: ClassVar[tuple[str, ...]] = (TRAINING,)
    n_robots: ClassVar[int] = 1
    n_seeds: ClassVar[int] = 1

    speeds: Annotated[tuple[float, ...], FEW, DISTINCT] = ()
    yaw_rates: Annotated[tuple[float, ...], MinLen(1), FEW, DISTINCT] = (-0.5, 0.0, 0.5)
    dwell: Count = 8
    dwells: Annotated[tuple[int, ...], FEW, DISTINCT] = ()
    n_strides: Count = 60
    step_sizes: Annotated[tuple[StepSize, ...], MinLen(2), FEW, DISTINCT] = (1e-3, 3e-3, 1e-2)

    def cases(self) -> list[Case]:
        """Lists the policies, once the gait is found to be made for every command."""
        for gait in self.gaits:
            self._commands(gait)
        return super().cases()

    def measure(self, case: Case) -> pd.DataFrame:
        """Analyses the stride map of one policy: a row a command."""
        stride_map = StrideMap(case.gait, case.alone, self._commands(case.gait))
        records = analyse(
            stride_map, n_strides=self.n_strides, step_sizes=self.step_sizes, seed=case.seed
        )
        return pd.DataFrame({"record": records})

    def report(self, table: pd.DataFrame) -> Report:
        """Reports orbits, modes, and predicted against simulated decay."""
        results = {
            str(policy): own["record"].tolist()
            for policy, own in table.groupby("policy", sort=False)
        }
        gait = str(table["gait"].iloc[0])
        summed = summary_table(results)
        return Report(
            tables={
                "summary": summed,
                "stability": stability_table(results),
                "prediction": prediction_table(results),
            },
            metrics=_without_nan(results),
            figures={"stability": stability_figure(results, gait.capitalize())},
            shown={f"{gait}: the stride map": summed},
        )

    def _commands(self, gait: Gait) -> Command:
        """Lists the commands: every speed with every yaw rate, then the further dwells.

        Raises:
            InputError: if the gait is not made for one.
        """
        speeds = self.speeds or tuple(np.linspace(SLOWEST, distilled_speeds(gait)[1], 3).tolist())
        dwells = self.dwells or tuple(range(gait.dwell[0], gait.dwell[1] + 1))
        grid = [(speed, rate, self.dwell) for speed in speeds for rate in self.yaw_rates]
        middle = speeds[len(speeds) // 2], self.yaw_rates[len(self.yaw_rates) // 2]
        grid += [(*middle, dwell) for dwell in dwells if dwell != self.dwell]
        for speed, yaw_rate, dwell in grid:
            FixedCommand(speed, yaw_rate, dwell).check(gait)
        values = np.array(grid, dtype=float)
        return Command(values[:, :2], values[:, 2])


def _without_nan(values: Any) -> Any:
    """Puts null where JSON has no NaN."""
    if isinstance(values, Mapping):
        return {name: _without_nan(value) for name, value in values.items()}
    if isinstance(values, list):
        return [_without_nan(value) for value in values]
    return None if isinstance(values, float) and not np.isfinite(values) else values
