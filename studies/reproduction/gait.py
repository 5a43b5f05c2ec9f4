"""Distils, evaluates and explains one gait for the report."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.figures import gait_figure, save_figure
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students import load_students, policy_title
from glassgait.studies.distillation.study import distill, write_r2_table
from glassgait.studies.evaluation.alternation import alternation_report, alternation_scores
from glassgait.studies.evaluation.tables import standalone_table
from glassgait.studies.importance.figures import contribution_figure, student_figures
from glassgait.studies.importance.study import (
    held_out_samples,
    importance_report,
    measure_importances,
)

JOINT = 0
"""The joint of the paper's single-joint figures, FL hip."""

SEQUENCE_STEPS = 200
EXPLAINED_STEP = 100
SPEED = 0.5
"""Commanded forward speed of the gait sequences (m/s)."""


@dataclass(frozen=True)
class GaitResults:
    """Results of one gait.

    Attributes:
        r2: R² of each student, as `distill` returns them.
        standalone: Scores without the expert, formatted.
        tops: The most important observations beside the paper's.
    """

    gait: str
    folder: Path
    r2: pd.DataFrame
    standalone: pd.DataFrame
    tops: pd.DataFrame


def study_gait(
    gait: Gait,
    expert: NeuralPolicy,
    folder: Path,
    *,
    distillation: DistillationConfig,
    rollouts: RolloutConfig,
    periods: tuple[int, ...],
    n_samples: int,
    repeats: int,
) -> GaitResults:
    """Distils, evaluates and explains one gait, from where an earlier run stopped."""
    # Section III-C of the paper: students, and their R² (Table II).
    name, title = gait.name, gait.name.capitalize()
    source = folder / "distillation"
    r2 = distill(distillation, gait, expert, source, resume=True)
    write_r2_table(r2, name, source)
    students = load_students(source, expert)

    # Section IV-A: returns against the alternation ratio (Figure 2).
    say(f"{title}: rolling out every student at every alternation ratio")
    kept = folder / "rollouts"
    scores = alternation_scores(gait, expert, students, rollouts, kept, periods)
    alternation_report(scores, title).write(folder)
    standalone = standalone_table(scores)

    # Section IV-B: importances and explanations of the ensembles (Table I, Figures 6 to 11).
    seed = rollouts.seed
    explained = {kind: students[kind] for kind in ("gbm", "ebm")}
    measured = []
    for kind, student in explained.items():
        samples = held_out_samples(source, kind, n_samples, seed)
        found = measure_importances(student, samples, seed=seed, repeats=repeats)
        measured.append(found.assign(policy=kind))
        drawn = student_figures(name, kind, student, JOINT, samples.observations, seed)
        Report(figures=drawn).write(folder)
    report = importance_report(name, pd.concat(measured, ignore_index=True))
    report.write(folder)
    tops = report.tables["top_observations"]

    # Gait sequences of every student (Figures 3 to 5), and a local explanation (Figure 9).
    scenario = Scenario(command=FixedCommand(speed=min(SPEED, gait.max_speed)))
    for kind, student in students.items():
        diagram = MakeLocomotion(gait, scenario, policy=alone(student, expert))
        rollout = record(make_simulator(diagram), SEQUENCE_STEPS)
        drawn = f"{title}, {policy_title(kind)}"
        save_figure(gait_figure(rollout, gait, f"{drawn} alone"), folder / f"{kind}_sequence")
        if kind == "ebm":
            step = min(EXPLAINED_STEP, len(rollout.time) - 1)
            parts = student.explain(rollout["observations"][step], JOINT)
            local = contribution_figure(parts, f"{drawn}, FL hip, step {step}")
            save_figure(local, folder / f"{kind}_local")
    return GaitResults(name, folder, r2, standalone, tops[tops["student"] == "gbm"])
