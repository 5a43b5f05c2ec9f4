"""`glassgait evaluate scenarios`: falls, return and tracking of every policy in every scenario."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

from glassgait.models.settings import Count, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.termination import PHYSICAL_FALL
from glassgait.studies.common.experiment import Case, Experiment, Report, ScenarioNames

if TYPE_CHECKING:
    import pandas as pd


@checked
class Scenarios(Experiment):
    """Let policies walk without the expert in every scenario, and report scores and falls.

    Attributes:
        n_steps: Control steps of a rollout.
    """

    title: ClassVar[str] = "evaluate scenarios"

    scenario: ScenarioNames = ("all",)
    n_steps: Count = EPISODE_STEPS

    def run(self) -> None:
        """Runs all gaits together, since the map of falls shows them side by side."""
        self.run_in(self.output or self.default_output())

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls out the robots of one seed, and scores them.

        If any robot falls, all are rolled out again with the physical fall rule, for the column
        `fell_physically`.
        """
        from glassgait.studies.common.rollouts import RolloutConfig, score

        config = RolloutConfig(self.n_robots, self.n_steps, case.seed)
        physical = replace(case.scenario, limits=PHYSICAL_FALL)
        scores = score(case.gait, case.controller, case.scenario, config)
        again = scores
        if scores["fell"].any() and physical != case.scenario:
            again = score(case.gait, case.controller, physical, config)
        return scores.assign(fell_physically=again["fell"])

    def report(self, table: pd.DataFrame) -> Report:
        """Reports the scores of each policy and scenario, and draws the map of falls."""
        import pandas as pd

        from glassgait.studies.common.tables import json_records
        from glassgait.studies.evaluation import figures, tables

        titles = {name: scenario.title for name, scenario in self.scenarios.items()}
        falls = {
            str(gait): tables.with_reading_cost(
                tables.fall_table(scores, titles), self.acting(str(gait))
            )
            for gait, scores in table.groupby("gait", sort=False)
        }
        titled = {gait: tables.titled_table(summary) for gait, summary in falls.items()}
        shown = {gait: tables.titled_table(summary, tables.MAIN) for gait, summary in falls.items()}
        records = [summary.assign(gait=gait) for gait, summary in falls.items()]
        return Report(
            tables={
                "robots": table,
                "scenarios": pd.concat(titled, names=["gait"]).reset_index("gait"),
            },
            metrics={"scenarios": json_records(pd.concat(records))},
            figures={"scenarios": figures.fall_map(falls)},
            shown={f"{gait}: falls": summary for gait, summary in shown.items()},
            line=tables.significant_differences(list(falls.values())),
        )
