"""`glassgait evaluate pushes`: which pushes walking robots survive, from every side."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from annotated_types import Ge, Gt, Le, MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, FEW, Count
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report
from glassgait.studies.common.summary import wilson_interval
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.push_basin import PushGrid, failure_counts, push_everywhere
from glassgait.studies.evaluation.pushes_figures import Basin, push_figure

PushSpeed = Annotated[float, Gt(0.0), Le(20.0)]

Seconds = Annotated[float, Ge(1.0), Le(9.0)]
"""Time from the push to the end (s): a second at least, in which a robot must walk; with 10 s comes
a new command."""


@dataclass(frozen=True)
class Pushes(Experiment):
    """Push walking robots from every side, and draw which pushes each policy survives.

    Attributes:
        command: What the robots are commanded.
        n_directions: Directions of pushes, equally far apart.
        speeds: What a push adds to the trunk's velocity (m/s).
        n_phases: Instants of the gait's cycle in which robots are pushed.
        seconds: Time from the push until a robot must still walk (s).
    """

    title: ClassVar[str] = "evaluate pushes"
    one_scenario: ClassVar[bool] = True
    discrete: ClassVar[bool] = True
    n_robots: ClassVar[int] = 1
    n_seeds: ClassVar[int] = 1

    command: FixedCommand = field(default_factory=FixedCommand)
    n_directions: Annotated[Count, Ge(3), Le(360)] = 12
    speeds: Annotated[tuple[PushSpeed, ...], MinLen(1), FEW, DISTINCT] = (
        0.3,
        0.6,
        0.9,
        1.2,
        1.5,
        1.8,
        2.1,
        2.4,
        2.7,
        3.0,
    )
    n_phases: Annotated[Count, Le(1000)] = 8
    seconds: Seconds = 5.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if list(self.speeds) != sorted(self.speeds):
            raise InputError(f"{self.title}: speeds is {self.speeds}; name the least first")

    def cases(self) -> list[Case]:
        """Lists the policies, once the gait is found to be made for the command."""
        for gait in self.gaits:
            self.command.check(gait)
        return super().cases()

    def measure(self, case: Case) -> pd.DataFrame:
        """Pushes the robots of one policy: a row of counts by direction, speed and kind of end."""
        pushed = push_everywhere(
            case.gait,
            case.alone,
            replace(case.scenario, command=self.command),
            self._grid(),
            n_steps=round(self.seconds / CONTROL_PERIOD),
            seed=case.seed,
        )
        survived = pushed.survived.sum(axis=2).tolist()
        return pd.DataFrame([{"survived": survived, "failures": failure_counts(pushed)}])

    def report(self, table: pd.DataFrame) -> Report:
        """Reports which pushes each policy survives."""
        basins = {
            row["policy"]: Basin(self._grid(), np.array(row["survived"]), row["failures"])
            for row in table.to_dict(orient="records")
        }
        summed, gait = summary_table(basins), table["gait"].iloc[0]
        title = (
            f"{gait.capitalize()} at {self.command.speed:g} m/s: which pushes are survived. "
            f"Direction as angle, speed (m/s) as radius; the line is where half survive"
        )
        return Report(
            tables={"summary": summed, "pushes": push_table(basins)},
            metrics=json_records(summed),
            figures={"pushes": push_figure(basins, title)},
            shown={f"{gait}: pushes": summed},
        )

    def _grid(self) -> PushGrid:
        directions = 2.0 * np.pi * np.arange(self.n_directions) / self.n_directions
        return PushGrid(directions, np.array(self.speeds), self.n_phases)


def summary_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Makes a row of each policy."""
    rows = []
    for policy, basin in basins.items():
        n_pushes = int(np.prod(basin.grid.shape))
        survived = int(basin.survived.sum())
        low, high = wilson_interval(survived, n_pushes)
        weakest = int(basin.shares.mean(axis=1).argmin())
        ends = sorted(basin.failures.items(), key=lambda end: -end[1])
        row: dict[str, Any] = {
            "policy": policy_title(policy),
            "all survived up to (m/s)": basin.all_up_to,
            "half survived up to (m/s)": basin.half_up_to,
            "survived": f"{survived} of {n_pushes}",
            "share": survived / n_pushes,
            "95 % from": low,
            "95 % to": high,
            "weakest direction": f"{np.degrees(basin.grid.directions[weakest]):.0f}°",
            "how the others ended": ", ".join(
                f"{name.replace('_', ' ')} {count}" for name, count in ends if count
            )
            or "–",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def push_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Makes a row of each policy, direction and speed."""
    rows = []
    for policy, basin in basins.items():
        for i, direction in enumerate(basin.grid.directions):
            for j, speed in enumerate(basin.grid.speeds):
                survived = int(basin.survived[i, j])
                low, high = wilson_interval(survived, basin.grid.n_phases)
                rows.append(
                    {
                        "policy": policy_title(policy),
                        "direction (°)": round(float(np.degrees(direction)), 6),
                        "speed (m/s)": float(speed),
                        "robots": basin.grid.n_phases,
                        "survived": survived,
                        "share": survived / basin.grid.n_phases,
                        "95 % from": low,
                        "95 % to": high,
                    }
                )
    return pd.DataFrame(rows)
