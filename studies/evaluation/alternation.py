"""`glassgait evaluate alternation`: return against the share of steps at which the expert acts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from annotated_types import MinLen

from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, FEW, Count, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.alternation import parse_ratio, ratio_title
from glassgait.studies.common.experiment import Case, Experiment, Report, run_cases

if TYPE_CHECKING:
    import pandas as pd

    from glassgait.models.policies.policy import Policy
    from glassgait.models.task.gait import Gait
    from glassgait.studies.common.rollouts import RolloutConfig

PERIODS = (1, 2, 4, 6, 8, 0)
"""Control steps from one action of the expert to the next: ratios 1, 1/2, 1/4, 1/6, 1/8 and 0."""


@checked
class Alternation(Experiment):
    """Alternate between expert and student, and report the return at every ratio.

    Attributes:
        n_steps: Control steps of a rollout.
        ratios: Shares of steps at which the expert acts: 1, 1/2, …, or 0 for only the student.
    """

    title: ClassVar[str] = "evaluate alternation"

    n_steps: Count = EPISODE_STEPS
    ratios: Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT] = tuple(map(ratio_title, PERIODS))

    def __post_init__(self) -> None:
        """Adds the expert, whose return is the reference; refuses invalid ratios."""
        if 1 not in map(parse_ratio, self.ratios):
            object.__setattr__(self, "ratios", (ratio_title(1), *self.ratios))
        if not {"expert", "all"} & {*self.policy}:
            object.__setattr__(self, "policy", ("expert", *self.policy))

    def cases(self) -> list[Case]:
        """Lists every student at every ratio below 1, and the expert once, at ratio 1."""
        self.require_one_scenario()
        cases = [
            replace(
                case,
                labels={**case.labels, "ratio": _share(period)},
                controller=replace(case.controller, period=period),
            )
            for case in super().cases()
            for period in map(parse_ratio, self.ratios)
            if (period == 1) == (case.controller.student is None)
        ]
        if not any(case.controller.student for case in cases):
            raise InputError(f"{self.title}: no student acts; give one, and a ratio below 1")
        return cases

    def measure(self, case: Case) -> pd.DataFrame:
        from glassgait.studies.common.rollouts import RolloutConfig

        return _score(RolloutConfig(self.n_robots, self.n_steps), case)

    def report(self, table: pd.DataFrame) -> Report:
        """Reports return and falls by ratio, and the students' scores without the expert."""
        name = self.gaits[0].name
        return alternation_report(table, name, self.acting(name))


def alternation_scores(
    gait: Gait,
    expert: Policy,
    students: Mapping[str, Policy],
    config: RolloutConfig,
    folder: Path,
    periods: tuple[int, ...] = PERIODS,
) -> pd.DataFrame:
    """Scores every student at every ratio, in the nominal scenario.

    All have the same initial states, commands and noise.
    """
    from glassgait.diagrams.scenario import Scenario
    from glassgait.models.policies.controller import Controller, alone

    scenario = config.commanding(Scenario())
    scenario.command.check(gait)
    acting = {("expert", _share(1)): alone(expert)} | {
        (kind, _share(period)): Controller(expert, student, period)
        for kind, student in students.items()
        for period in periods
        if period != 1
    }
    cases = [
        Case({"policy": kind, "ratio": ratio, "seed": seed}, gait, controller, scenario, seed)
        for (kind, ratio), controller in acting.items()
        for seed in config.seeds
    ]
    return run_cases(cases, partial(_score, config), folder)


def alternation_report(scores: pd.DataFrame, title: str, policies: Mapping[str, Policy]) -> Report:
    """Reports scores, one row per robot, by their columns `policy` and `ratio`."""
    from glassgait.studies.common.tables import json_records
    from glassgait.studies.evaluation import figures, tables

    ratios, standalone = tables.alternation_table(scores), tables.standalone_table(scores, policies)
    return Report(
        tables={"robots": scores, "ratios": tables.titled_table(ratios), "standalone": standalone},
        metrics=json_records(ratios),
        figures={"return": figures.return_figure(scores, title)},
        shown={f"{title}: students without the expert": standalone},
    )


def _share(period: int) -> float:
    """Returns the alternation ratio of a period, as a number for tables."""
    return 1.0 / period if period else 0.0


def _score(config: RolloutConfig, case: Case) -> pd.DataFrame:
    from glassgait.studies.common.rollouts import score

    return score(case.gait, case.controller, case.scenario, replace(config, seed=case.seed))
