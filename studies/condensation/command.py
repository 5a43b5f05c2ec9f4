"""`glassgait condense`: makes formulas so short that a gait stands on a page."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro

from glassgait.models.policies.library import load_expert
from glassgait.models.policies.symbolic import FormulaPolicy, StatewiseSymbolicPolicy
from glassgait.models.settings import Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.condensation.config import CondensationConfig
from glassgait.studies.condensation.study import make_page
from glassgait.studies.console import console, say
from glassgait.studies.evaluation.alternation import alternation_jobs
from glassgait.studies.rollouts.config import RolloutConfig
from glassgait.studies.rollouts.jobs import run_jobs
from glassgait.studies.rollouts.scores import summarize_against
from glassgait.studies.run_folder import open_run
from glassgait.studies.tables import print_table, write_metrics, write_table


@dataclass(frozen=True)
class Condense(Settings):
    """Copy an expert into so few terms that they stand on a page, and let them walk alone.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        config: How the page is made.
        rollouts: How its robots are rolled out in the end.
        expert: Policy file of the expert; the shipped one by default.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/condensation/<gait> by default.
    """

    title: ClassVar[str] = "condense"

    gait: str = "trot"
    config: Annotated[CondensationConfig, tyro.conf.arg(name="")] = field(
        default_factory=CondensationConfig
    )
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="rollouts")] = field(
        default_factory=lambda: RolloutConfig(n_seeds=1)
    )
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.gait)
        expert = load_expert(gait, self.expert)
        folder = self.output or Path("runs/condensation") / gait.name
        inputs = {"gait": gait.digest(), "expert": expert.digest()}
        with open_run(
            folder, study="condense", settings=self, inputs=inputs, resume=self.resume
        ) as run:
            page = make_page(self.config, gait, expert, folder, run, say)
            path = folder / f"{StatewiseSymbolicPolicy.kind}{page.suffix}"
            page.save(path)
            say("letting it walk alone")
            jobs = alternation_jobs(gait, expert, {"page": page}, self.rollouts, periods=(1, 0))
            scores = run_jobs(jobs, folder / "rollouts")
            table = page_table(page, gait, scores)
            write_table(table, folder / "page")
            write_metrics(table.to_dict(orient="records"), folder / "metrics.json")
        print_table(f"{gait.name}: the page alone, in the training world", table)
        console.print(f"written to {path}; 'glassgait show {gait.name} --policy {path}' prints it")


def page_table(page: FormulaPolicy, gait: Gait, scores: pd.DataFrame) -> pd.DataFrame:
    """Returns what a page is and what it earns, beside its expert."""
    means = summarize_against(scores, ["policy"], scores[scores["policy"] == "expert"])
    columns = ["policy", "robots", "falls", "share", "share_ci", "rhythm"]
    sizes = {"page": (page.n_terms(), len(page.to_text().splitlines()))}
    terms, lines = zip(*(sizes.get(name, ("", "")) for name in means["policy"]), strict=True)
    return means[columns].assign(gait=gait.name, terms=terms, lines=lines)
