"""`glassgait reproduce curricula`: what the curriculum of a distillation is worth."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
import tyro
from matplotlib.figure import Figure

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case, rollout_cases, run_rollouts
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import Report, Workers
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.policies import OneGait
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.scores import summarize_against
from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.distillation.config import Curriculum, DistillationConfig
from glassgait.studies.distillation.students.library import load_students
from glassgait.studies.distillation.students.registry import STUDENTS, student_title
from glassgait.studies.distillation.study import distill

CURRICULA = {
    "expert_only": "Expert acts (behaviour cloning)",
    "half": "Expert acts at half of the steps",
    "student_only": "Student acts (DAgger)",
    "alternation": "Alternation (the paper's)",
    "alternation_then_alone": "Alternation, then student alone",
}

TICKS = ("expert\nonly", "half", "student\nonly", "alternation", "alternation,\nthen alone")
"""What figures call them."""


@styled
def curricula_figure(table: pd.DataFrame, title: str) -> Figure:
    """Draws share of the expert's return and falls of each student, by curriculum."""
    figure, (share, falls) = subplots(
        2, 1, figsize=(COLUMN_WIDTH, 3.4), sharex=True, height_ratios=(3, 2)
    )
    students = list(dict.fromkeys(table["student"]))
    for i, student in enumerate(students):
        line = STUDENTS[student]
        mine = table[table["student"] == student].set_index("curriculum").reindex(list(CURRICULA))
        at = np.arange(len(TICKS)) + 0.12 * (i - (len(students) - 1) / 2)
        style = {"color": line.color, "marker": line.marker, "markersize": 3.5, "linestyle": "none"}
        share.errorbar(at, mine["share"], mine["share_ci"], label=line.title, capsize=1.5, **style)
        falls.plot(at, 100 * mine["fall_rate"].astype(float), **style)
    share.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    share.set(ylabel="share of the\nexpert's return", ylim=(0, None), title=title)
    share.legend(ncols=2, loc="lower right")
    falls.set(ylabel="falls (%)", ylim=(-5, 105), xlabel="what acts while samples are collected")
    falls.set_xticks(np.arange(len(TICKS)), TICKS)
    figure.align_ylabels()
    return figure


@dataclass(frozen=True)
class Curricula(OneGait):
    """Distil by other curricula with as many samples, and let the students walk alone.

    Attributes:
        distillation: Settings of the distillation with alternation and rounds alone; its curriculum
            does not count.
        rollouts: How students are rolled out.
        workers: Where students are made and rolled out.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/reproduce/curricula/<gait> by default.
    """

    title: ClassVar[str] = "reproduce curricula"

    distillation: Annotated[DistillationConfig, tyro.conf.arg(name="")] = field(
        default_factory=DistillationConfig
    )
    rollouts: RolloutConfig = field(default_factory=RolloutConfig)
    workers: Workers = field(default_factory=WorkersConfig)
    resume: bool = False
    output: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        # Refused now, where a curriculum's own settings would be.
        equal_budgets(self.distillation)

    def run(self) -> None:
        """Runs the study."""
        found = self.policies()
        gait = found.gait
        folder, expert = self.output or found.output(self.title), found.expert
        inputs = {"gait": gait.digest(), "expert": expert.digest()}
        run = {"study": self.title, "settings": self, "resume": self.resume}
        with open_run(folder, **run, inputs=inputs), parallel_backend(self.workers.backend):
            fits: list[pd.DataFrame] = []
            students: dict[str, dict[str, Policy]] = {}
            n_workers = self.workers.n_workers
            planned = replace(self.distillation, gait=self.gait, n_workers=n_workers)
            for name, config in equal_budgets(planned).items():
                say(CURRICULA[name])
                own = folder / name
                r2 = distill(config, gait, expert, own, say, resume=self.resume)
                fits.append(r2.assign(curriculum=name)[["curriculum", "student", "r2"]])
                students[name] = load_students(own, expert)
            cases = standalone_cases(gait, expert, students, self.rollouts)
            scores = run_rollouts(cases, folder / "rollouts", processes=self.workers.processes)
            table = curricula_table(pd.concat(fits, ignore_index=True), scores)
            report = Report(
                tables={"robots": scores, "curricula": table},
                metrics=table.to_dict(orient="records"),
                figures={"curricula": curricula_figure(table, gait.name.capitalize())},
                shown={f"{gait.name}: students alone": titled(table)},
            )
            report.write(folder)
        report.show()
        console.print(f"written to {folder}")


def equal_budgets(config: DistillationConfig) -> dict[str, DistillationConfig]:
    """Returns the settings of each curriculum, all of as many episodes of equal length.

    Without rounds of the student alone, alternation goes on to lower ratios instead.
    """
    size = config.episodes_per_round
    config = replace(
        config,
        alone_episodes=size,
        alone_steps=config.episode_steps,
        settings=config.settings.with_alone_episodes(size),
    )
    rounds_alone = config.alone_rounds * size
    whole = replace(config, episodes=config.episodes + rounds_alone, alone_rounds=0)
    names: tuple[Curriculum, ...] = ("expert_only", "half", "student_only", "alternation")
    return {name: replace(whole, curriculum=name) for name in names} | {
        "alternation_then_alone": replace(config, curriculum="alternation")
    }


def standalone_cases(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Mapping[str, Policy]],
    config: RolloutConfig,
) -> list[Case]:
    """Lists rollouts of the expert, whose curriculum is called `expert`, and of students alone."""
    policies = {("expert", "expert"): alone(expert)}
    for curriculum, own in students.items():
        policies |= {(curriculum, kind): alone(student, expert) for kind, student in own.items()}
    return [
        case
        for (curriculum, student), policy in policies.items()
        for case in rollout_cases(
            {"curriculum": curriculum, "student": student}, gait, policy, Scenario(), config
        )
    ]


def curricula_table(fits: pd.DataFrame, scores: pd.DataFrame) -> pd.DataFrame:
    """Joins R² with what each student earns alone.

    Args:
        fits: Columns `curriculum`, `student` and `r2` on held-out episodes.
        scores: Scores of the robots, with `curriculum` (`expert` for the expert) and `student`.

    Returns:
        A row a student and curriculum: `r2`, `robots`, `falls`, `fall_rate`, `return`, `return_ci`,
        and the return's `share` of the expert's with its interval `share_ci`.
    """
    by = ["curriculum", "student"]
    means = summarize_against(scores, by, scores[scores["curriculum"] == "expert"])
    columns = ["robots", "falls", "fall_rate", "return", "return_ci", "share", "share_ci"]
    return fits.merge(means[[*by, *columns]], on=by)


def titled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the table for reading."""
    falls = zip(table["falls"], table["robots"], strict=True)
    shares = zip(table["share"], table["share_ci"], strict=True)
    return pd.DataFrame(
        {
            "samples collected while": table["curriculum"].map(CURRICULA),
            "student": table["student"].map(student_title),
            "R² held out": table["r2"].round(3),
            "share of expert": [f"{share:.3f} ± {half:.3f}" for share, half in shares],
            "falls": [f"{fallen} of {robots}" for fallen, robots in falls],
        }
    )
