"""`glassgait pareto`: closed-loop reward of formulas against their size."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
import tyro
from annotated_types import MinLen

from glassgait.models.policies.library import load_expert, load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.settings import DISTINCT, FEW, Count, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.console import console, say
from glassgait.studies.evaluation.alternation import alternation_jobs
from glassgait.studies.figures import save_figure
from glassgait.studies.pareto.figures import pareto_figure
from glassgait.studies.pareto.formulas import FAMILIES, LENGTHS
from glassgait.studies.rollouts.config import RolloutConfig
from glassgait.studies.rollouts.jobs import run_jobs
from glassgait.studies.rollouts.scores import summarize_against
from glassgait.studies.run_folder import digest_of_files, open_run
from glassgait.studies.students.dataset import Dataset, load_rounds, r2_scores, round_paths
from glassgait.studies.students.library import distillation_folder, samples_folder
from glassgait.studies.students.symbolic import STATEWISE_SYMBOLIC
from glassgait.studies.tables import print_table, write_metrics, write_table

SHARES = (0.0, 0.9, 0.97)
"""Shares of the expert's reward for which the smallest formulas are named."""

MIN_RHYTHM = 0.9
"""Share of the rhythm below which a robot does not walk."""


@dataclass(frozen=True)
class Pareto(Settings):
    """Fit formulas of growing size, let each walk alone, and name the smallest that walk.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        samples: Folder of the rounds that a student collected, whose samples the formulas are
            fitted to; runs/distillation/<gait>/statewise_symbolic by default.
        lengths: Greatest lengths of a joint's formula (nodes).
        rollouts: How robots are rolled out.
        expert: Policy file of the expert; the shipped one by default.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/pareto/<gait> by default.
    """

    title: ClassVar[str] = "pareto"

    gait: str = "trot"
    samples: Path | None = None
    lengths: Annotated[tuple[Count, ...], MinLen(1), FEW, DISTINCT] = LENGTHS
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_seeds=1)
    )
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.gait)
        expert = load_expert(gait, self.expert)
        samples = self.samples or samples_folder(
            distillation_folder(gait.name), STATEWISE_SYMBOLIC.name
        )
        data = load_rounds(samples)
        folder = self.output or Path("runs/pareto") / gait.name
        inputs = {
            "gait": gait.digest(),
            "expert": expert.digest(),
            "samples": digest_of_files(round_paths(samples)),
        }
        with open_run(folder, study="pareto", settings=self, inputs=inputs, resume=self.resume):
            front = self._measure(gait, expert, data, folder)
            smallest = smallest_that_walk(front)
            write_table(front, folder / "pareto")
            write_table(smallest, folder / "smallest")
            write_metrics(front.to_dict(orient="records"), folder / "metrics.json")
            save_figure(pareto_figure(front, gait.name.capitalize()), folder / "pareto")
        print_table(f"{gait.name}: formulas alone", front)
        if len(smallest):
            print_table(f"{gait.name}: the smallest with which every robot walks", smallest)
        else:
            console.print(f"{gait.name}: with none of these sizes does every robot walk")
        console.print(f"written to {folder}")

    def _measure(
        self, gait: Gait, expert: NeuralPolicy, data: Dataset, folder: Path
    ) -> pd.DataFrame:
        """Fits the formulas that the folder lacks, and rolls all of them out."""
        seen, held_out = data.subset(~data.held_out), data.subset(data.held_out)
        students, rows = {}, []
        for name, family in FAMILIES.items():
            say(f"fitting: {family.title}")
            for length in self.lengths:
                label = f"{name} {length}"
                path = folder / "formulas" / f"{name}_{length}{FormulaPolicy.suffix}"
                if not path.exists():
                    family.fit(gait.name, expert.observation_names, seen, length).save(path)
                student = load_policy(path)
                assert isinstance(student, FormulaPolicy)
                students[label] = student
                r2 = float(r2_scores(student, held_out).mean())
                nodes = mean_nodes(student)
                rows.append({"policy": label, "family": name, "nodes": nodes, "r2": r2})
        jobs = alternation_jobs(gait, expert, students, self.rollouts, periods=(1, 0))
        return pareto_table(pd.DataFrame(rows), run_jobs(jobs, folder / "rollouts"))


def mean_nodes(policy: FormulaPolicy) -> float:
    """Counts the nodes of a joint's formulas, of all states together, the mean of the joints."""
    nodes = [[formula.length for formula in own] for own in policy.formulas_by_state]
    return float(np.sum(nodes, axis=0).mean())


def pareto_table(fits: pd.DataFrame, scores: pd.DataFrame) -> pd.DataFrame:
    """Joins the fits with their scores alone: share of the expert's reward, and falls."""
    means = summarize_against(scores, ["policy"], scores[scores["policy"] == "expert"])
    columns = ["robots", "falls", "fall_rate", "share", "share_ci", "reward", "reward_ci", "rhythm"]
    front = fits.merge(means[["policy", *columns]], on="policy")
    return front.sort_values("nodes", ignore_index=True)


def smallest_that_walk(front: pd.DataFrame) -> pd.DataFrame:
    """Names the smallest formulas with which every robot walks, for growing shares of the reward.

    A robot walks that does not fall and keeps the rhythm; the smallest formulas of all stand still.
    Where no size does, there is no row.
    """
    walks = front[(front["falls"] == 0) & (front["rhythm"] >= MIN_RHYTHM)].sort_values("nodes")
    scores = ["nodes", "r2", "share", "share_ci", "rhythm", "robots"]
    rows = []
    for share in SHARES:
        enough = walks[walks["share"] >= share]
        if len(enough):
            best = enough.iloc[0]
            title = FAMILIES[best["family"]].title
            rows.append({"share asked for": share, "formulas": title, **best[scores]})
    return pd.DataFrame(rows, columns=["share asked for", "formulas", *scores])
