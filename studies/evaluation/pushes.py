"""`glassgait evaluate pushes`: which pushes walking robots survive, from every side."""

from __future__ import annotations

from dataclasses import field, replace
from typing import TYPE_CHECKING, Annotated, ClassVar

from annotated_types import Ge, Gt, Le, MinLen

from glassgait.models.settings import DISTINCT, FEW, Count, checked
from glassgait.studies.common.experiment import Case, Experiment, Report
from glassgait.studies.common.rollouts import CommandOverride

if TYPE_CHECKING:
    import pandas as pd

SPEEDS = tuple(round(0.3 * i, 1) for i in range(1, 11))

PushSpeed = Annotated[float, Gt(0.0), Le(20.0)]

Steps = Annotated[int, Ge(50), Le(450)]
"""Control steps from the push to the end: at least 1 s, in which a robot must walk, and less than
10 s, when a new command comes."""


@checked
class Pushes(Experiment):
    """Push walking robots from every side, and draw which pushes each policy survives.

    Attributes:
        command: Command of the robots; by default 0.5 m/s, or the gait's greatest speed.
        n_phases: Number of instants in the gait's cycle at which robots are pushed.
        n_steps: Control steps after the push; robots that walk at the end survived.
        n_directions: Number of push directions, evenly spaced.
        speeds: Speeds that pushes add to the trunk's velocity (m/s).
    """

    title: ClassVar[str] = "evaluate pushes"
    n_robots: ClassVar[int] = 1
    n_seeds: ClassVar[int] = 1

    command: CommandOverride = field(default_factory=CommandOverride)
    n_phases: Annotated[Count, Le(1000)] = 8
    n_steps: Steps = 250
    n_directions: Annotated[Count, Ge(3), Le(360)] = 12
    speeds: Annotated[tuple[PushSpeed, ...], MinLen(1), FEW, DISTINCT] = SPEEDS

    def cases(self) -> list[Case]:
        """Lists one case per policy, in which all robots follow one command."""
        self.require_one_scenario()
        return [
            replace(case, scenario=replace(case.scenario, command=self.command.override(case.gait)))
            for case in super().cases()
        ]

    def measure(self, case: Case) -> pd.DataFrame:
        """Pushes the robots of one policy, and returns one row per push."""
        from glassgait.studies.evaluation.pushing import push_everywhere

        return push_everywhere(
            case.gait,
            case.controller,
            case.scenario,
            n_directions=self.n_directions,
            speeds=self.speeds,
            n_phases=self.n_phases,
            n_steps=self.n_steps,
            seed=case.seed,
        )

    def report(self, table: pd.DataFrame) -> Report:
        from glassgait.studies.common.tables import json_records
        from glassgait.studies.evaluation import figures, tables

        summary, gait = tables.push_summary(table), table["gait"].iloc[0]
        title = (
            f"{gait.capitalize()} at {self.command.override(self.gaits[0]).speed:g} m/s: which "
            f"pushes are survived. Direction as angle, speed as radius, to {max(self.speeds):g} m/s"
        )
        return Report(
            tables={"summary": summary, "pushes": tables.push_table(table)},
            metrics=json_records(summary),
            figures={"pushes": figures.push_figure(table, title)},
            shown={f"{gait}: pushes": summary},
        )
