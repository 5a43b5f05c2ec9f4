"""`glassgait importance`: what each student looks at, and whether that is true."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro
from annotated_types import Ge

from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import DISTINCT, FEW, Count, Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.cases import run_rollouts
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import Workers
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.policies import EXPERT, Policies, find_policies, policy_stem
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.common.run_folder import digest_of_files, open_run
from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.distillation.students.baselines import STATEWISE_LINEAR
from glassgait.studies.distillation.students.boosting import EBM, GBM
from glassgait.studies.distillation.students.dataset import round_paths
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.registry import STUDENTS, policy_title
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC
from glassgait.studies.importance.faithfulness import (
    MODE_TITLES,
    ablation_cases,
    losses,
    rank_correlations,
)
from glassgait.studies.importance.figures import draw_student, faithfulness_figure, loss_figure
from glassgait.studies.importance.measures import METHOD_TITLES
from glassgait.studies.importance.study import (
    held_out_samples,
    measure_importances,
    visited_samples,
)

MEASURED = (GBM.name, EBM.name, STATEWISE_LINEAR.name, SYMBOLIC.name, STATEWISE_SYMBOLIC.name)
"""Kinds of students that are measured where none are named."""


COLUMNS = (
    "rank correlation: Spearman's, over groups of observations, of a method's importance with the "
    "share of return lost without the group; 1 is the same order, 0 none",
    "p: how often chance alone would give a correlation as far from 0",
)
"""What the columns of the printed table mean."""


@dataclass(frozen=True)
class Importance(Settings):
    """Measure what each student looks at, and take it away to see whether that is true.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: Kinds of students; by default those that there are of gbm, ebm, statewise_linear,
            symbolic and statewise_symbolic.
        joint: Joint whose trees and functions are drawn.
        n_samples: Samples that importances are measured on, at most; a student was fitted to none.
            They are those that a distillation held out or, of other students, new ones.
        repeats: Shuffles of each observation.
        rollouts: How robots are rolled out without observations; its seed is that of all shuffling.
        workers: Where rollouts run.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine, whose policies are taken; by default
            those that ship, and of a gait that does not ship those of runs/distill/<gait> and
            runs/train/<gait>.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/importance/<gait> by default.
    """

    title: ClassVar[str] = "importance"

    gait: str = "trot"
    policy: Annotated[tuple[str, ...], FEW, DISTINCT] = ()
    joint: str = "FL_hip"
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_robots=13, n_steps=500, n_seeds=1)
    )
    workers: Workers = field(default_factory=WorkersConfig)
    robot: str | None = None
    source: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.gait)
        policies = find_policies(gait, self.source, self.robot)
        expert = policies.expert
        joint, seed = joint_index(self.joint), self.rollouts.seed
        students = self._chosen(policies)
        source = _samples_of(policies, students)
        inputs = _inputs(policies, students, source)
        folder = self.output or policies.output(self.title)
        with open_run(folder, study=self.title, settings=self, inputs=inputs, resume=self.resume):
            samples = {
                kind: held_out_samples(source, kind, self.n_samples, seed)
                if source
                else visited_samples(gait, expert, student, self.n_samples, seed)
                for kind, student in students.items()
            }
            importances, _ = measure_importances(
                gait.name, students, samples, folder, seed=seed, repeats=self.repeats
            )
            for kind, student in students.items():
                observations = samples[kind].observations
                draw_student(gait.name, kind, student, joint, observations, folder, seed)
            means = {kind: own.observations.mean(axis=0) for kind, own in samples.items()}
            say("rolling out without each group of observations")
            jobs = ablation_cases(gait, expert, students, means, self.rollouts)
            with parallel_backend(self.workers.backend):
                scores = run_rollouts(jobs, folder / "rollouts", processes=self.workers.processes)
            lost = losses(scores)
            correlations = rank_correlations(importances, lost)
            _write(importances, lost, correlations, gait.name.capitalize(), folder)
        print_table(
            f"{gait.name}: rank correlation of importance and loss", readable_table(correlations)
        )
        for line in COLUMNS:
            say(line)
        console.print(f"written to {folder}")

    def _chosen(self, policies: Policies) -> dict[str, Policy]:
        chosen = self.policy or tuple(kind for kind in MEASURED if kind in policies.files)
        if EXPERT in chosen:
            raise InputError(
                f"--policy {EXPERT}: importances are those of students, measured against the "
                "expert; name kinds of students"
            )
        if not chosen:
            raise InputError(
                f"--policy: no student {', '.join(MEASURED)} of the {policies.gait.name} there; "
                "make one with 'glassgait distill "
                f"--gait {self.gait}', or name others"
            )
        return {policy_stem(name): policies.policy(name) for name in chosen}


def _samples_of(policies: Policies, students: Mapping[str, Policy]) -> Path | None:
    """Returns the folder whose samples the students were fitted to, if it is there."""
    folder = policies.folder
    if folder is None or not set(students) <= set(STUDENTS):
        return None
    kept = all(any(samples_folder(folder, kind).glob("round_*")) for kind in students)
    return folder if kept else None


def _inputs(
    policies: Policies, students: Mapping[str, Policy], source: Path | None
) -> dict[str, str]:
    """Returns the digests of all that the run depends on."""
    acting = [(kind, alone(student, policies.expert)) for kind, student in students.items()]
    inputs = policies.inputs(acting)
    if source:
        rounds = [path for kind in students for path in round_paths(samples_folder(source, kind))]
        inputs["samples"] = digest_of_files(rounds)
    return inputs


def _write(
    importances: pd.DataFrame,
    lost: pd.DataFrame,
    correlations: pd.DataFrame,
    title: str,
    folder: Path,
) -> None:
    for name, table in (("losses", lost), ("faithfulness", correlations)):
        write_table(table, folder / name)
    save_figure(loss_figure(lost, title), folder / "losses")
    save_figure(faithfulness_figure(importances, lost, title), folder / "faithfulness")
    tables = {"importances": importances, "losses": lost, "faithfulness": correlations}
    metrics = {name: table.to_dict(orient="records") for name, table in tables.items()}
    write_metrics(metrics, folder / "metrics.json")


def readable_table(correlations: pd.DataFrame) -> pd.DataFrame:
    """Names the rows and columns of `rank_correlations` as people do."""
    return pd.DataFrame(
        {
            "policy": correlations["policy"].map(policy_title),
            "importance by": correlations["method"].map(METHOD_TITLES),
            "observations": correlations["mode"].map(dict(MODE_TITLES)),
            "rank correlation": correlations["correlation"].round(2),
            "p": correlations["p_value"],
        }
    )
