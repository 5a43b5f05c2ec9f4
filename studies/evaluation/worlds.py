"""`glassgait evaluate worlds`: how policies that act alone walk in every scenario, and where they
fall."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import pandas as pd
from matplotlib.figure import Figure

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.settings import Count, Range
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.command import DEAD_BAND
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report, ScenarioNames
from glassgait.studies.common.policies import ALL
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.play import Seconds
from glassgait.studies.common.rollouts.scoring import not_finite_lines, refuse_commands, score
from glassgait.studies.common.scores import summarize
from glassgait.studies.common.tables import json_records
from glassgait.studies.evaluation.pair import Pair
from glassgait.studies.evaluation.worlds_figures import fall_map, fall_overview
from glassgait.studies.evaluation.worlds_tables import (
    fall_table,
    falls_table,
    readable_table,
    scorecard_table,
    worst_table,
)
from glassgait.studies.view.command import OwnCommand


@dataclass(frozen=True)
class Worlds(Experiment):
    """Let policies walk alone in every scenario, and report scores and falls.

    One policy gives a scorecard, several a map of falls; two also give the lines in which they
    differ, the difference of their joint targets, and one replay of both.

    Attributes:
        n_steps: Control steps of a rollout.
        speed_range: Least and greatest commanded forward speed (m/s), in place of the scenario's
            commands; by default the speeds of distillation, and of an expert by itself all speeds.
        command: Of two policies, the command of targets and replay, in place of the first
            scenario's; what is left out is the scenario's.
        seconds: Of two policies, the length of targets and replay (s); a fall ends it before.
    """

    title: ClassVar[str] = "evaluate worlds"
    together: ClassVar[bool] = True

    scenario: ScenarioNames = ("all",)
    n_steps: Count = EPISODE_STEPS
    speed_range: Range | None = None
    command: OwnCommand = field(default_factory=OwnCommand)
    seconds: Seconds = 10.0

    def cases(self) -> list[Case]:
        """Lists the rollouts, and refuses those that cannot be."""
        cases = [self._with_speeds(case) for case in super().cases()]
        for case in cases:
            refuse_commands(case)
        if pair := self._pair():
            pair.refuse_world()
        return cases

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots of one seed out, and scores them."""
        return score(case)

    def report(self, table: pd.DataFrame) -> Report:
        """Reports the scores of each policy and scenario, and what sets two policies apart."""
        lines = [
            *not_finite_lines(table),
            f"drawn speeds below {DEAD_BAND:g} m/s are commands to stand, which the speed error "
            "leaves out",
        ]
        if all(len(own) == 1 for own in self.controllers.values()):
            return self._scorecard(table, lines)
        falls = {
            str(gait): fall_table(own, self.scenario_titles)
            for gait, own in table.groupby("gait", sort=False)
        }
        whole = pd.concat([own.assign(gait=gait) for gait, own in falls.items()])
        readable = pd.concat(
            [_after_gait(gait, readable_table(own), len(falls)) for gait, own in falls.items()]
        )
        found = Report(
            tables={"robots": table, "worlds": readable},
            metrics={"worlds": json_records(whole)},
            figures=_maps(falls),
            shown={
                f"{gait}: where each falls most": worst_table(own) for gait, own in falls.items()
            },
            lines=lines,
        )
        pair = self._pair()
        return found if pair is None else _joined(found, pair.report(self.seconds, self.seed))

    def default_output(self, names: tuple[str, ...]) -> Path:
        """Returns the folder of a run where none is named; policies that are named stand in it."""
        folder = super().default_output(names)
        if self.policy == (ALL,):
            return folder
        policies = "_".join(Path(name).stem for name in self.policy)
        return folder.with_name(f"{folder.name}_{policies}")

    def _scorecard(self, table: pd.DataFrame, lines: list[str]) -> Report:
        card = scorecard_table(table, self.scenario_titles)
        falls = falls_table(table, self.scenario_titles)
        names = ", ".join(self.controllers)
        return Report(
            tables={"robots": table, "scorecard": card, "falls": falls},
            metrics=summarize(table, ["gait", "scenario"]).to_dict(orient="records"),
            shown={f"{names}: {', '.join(self.policy)}": card},
            lines=lines,
        )

    def _with_speeds(self, case: Case) -> Case:
        config = RolloutConfig(self.n_robots, self.n_steps, case.seed, 1, self.speed_range)
        own = self.controllers[case.gait.name]
        if len(own) > 1 or not isinstance(case.alone.policy, NeuralPolicy):
            config = config.at_distilled_speeds(case.gait, case.scenario)
        return case.with_config(config)

    def _pair(self) -> Pair | None:
        """Returns the two policies, where there are two of one gait."""
        (gait, *others), controllers = self.gaits, next(iter(self.controllers.values()))
        if others or len(controllers) != 2:
            return None
        return Pair(gait, controllers, self.command.over(next(iter(self.scenarios.values()))))


def _joined(report: Report, other: Report) -> Report:
    """Puts one report behind another."""
    return Report(
        {**report.tables, **other.tables},
        {**report.metrics, **other.metrics},
        {**report.figures, **other.figures},
        {**report.shown, **other.shown},
        [*report.lines, *other.lines],
        {**report.files, **other.files},
    )


def _after_gait(gait: str, table: pd.DataFrame, n_gaits: int) -> pd.DataFrame:
    if n_gaits > 1:
        table.insert(0, "gait", gait)
    return table


def _maps(falls: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draws a map of each gait, and of several all side by side."""
    title = "falls of each policy alone, worst scenario first"
    maps = {gait: fall_map(own, f"{gait.capitalize()}: {title}") for gait, own in falls.items()}
    if len(maps) == 1:
        return {"worlds": next(iter(maps.values()))}
    return {f"worlds_{gait}": own for gait, own in maps.items()} | {"worlds": fall_overview(falls)}
