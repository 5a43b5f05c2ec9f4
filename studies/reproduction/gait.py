"""What the report needs of one gait: students, scores, importances and figures, in its folder."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
import tyro
from annotated_types import Ge, MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import DISTINCT, FEW, Count, Natural, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.gait_figure import gait_figure
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students import load_students, paper_students, student_title
from glassgait.studies.distillation.study import distill, write_r2_table
from glassgait.studies.evaluation.alternation import PERIODS, alternation_report, alternation_scores
from glassgait.studies.evaluation.tables import standalone_table
from glassgait.studies.importance.figures import contribution_figure, student_figures
from glassgait.studies.importance.study import (
    held_out_samples,
    importance_report,
    measure_importances,
)

JOINT = 0
"""The joint of the paper's single-joint figures, FL hip."""

SEQUENCE_SECONDS = 4.0
EXPLAINED_STEP = 100
SPEED = 0.5
"""Commanded forward speed of the gait sequences (m/s)."""


PAPER_GAITS = ("walk", "trot", "pace", "bound")


@checked
class ReportConfig(Settings):
    """How much is computed for each gait.

    Attributes:
        distillation: Settings of the distillation; the gait is set for each.
        periods: Control steps from one action of the expert to the next, at each of which students
            are rolled out; 0 is never.
        rollouts: How robots are rolled out.
        n_samples: Held-out samples that importances are measured on.
        repeats: Shuffles of each observation.
    """

    title: ClassVar[str] = "report"

    distillation: Annotated[DistillationConfig, tyro.conf.Fixed] = field(
        default_factory=lambda: DistillationConfig(students=paper_students())
    )
    periods: Annotated[tuple[Natural, ...], MinLen(1), FEW, DISTINCT] = PERIODS
    rollouts: Annotated[RolloutConfig, tyro.conf.Fixed] = field(default_factory=RolloutConfig)
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10

    def rollouts_of(self, gait: Gait) -> RolloutConfig:
        """Returns how the robots of a gait are rolled out: at most as fast as it goes."""
        if self.rollouts.speed_range is None:
            return self.rollouts
        slowest, fastest = np.clip(self.rollouts.speed_range, -gait.max_speed, gait.max_speed)
        return replace(self.rollouts, speed_range=(float(slowest), float(fastest)))


@dataclass(frozen=True)
class GaitResults:
    """What was found about one gait.

    Attributes:
        gait: Its name.
        folder: Where its figures lie.
        r2: R² of each student, as `distill` returns them.
        standalone: Scores alone, formatted.
        tops: The most important observations beside the paper's.
    """

    gait: str
    folder: Path
    r2: pd.DataFrame
    standalone: pd.DataFrame
    tops: pd.DataFrame


def study_gait(name: str, expert: NeuralPolicy, config: ReportConfig, folder: Path) -> GaitResults:
    """Distils, evaluates and explains one gait, from where an earlier run stopped."""
    gait = load_gait(name)
    title = name.capitalize()
    distillation = replace(config.distillation, gait=name)
    source = folder / "distillation"
    r2 = distill(distillation, gait, expert, source, resume=True)
    write_r2_table(r2, name, source)
    students = load_students(source, expert)

    say(f"{title}: rolling out every student at every alternation ratio")
    rollouts = config.rollouts_of(gait)
    scores = alternation_scores(
        gait, expert, students, rollouts, folder / "rollouts", config.periods
    )
    alternation_report(scores, title).write(folder)
    standalone = standalone_table(scores)

    seed = config.rollouts.seed
    # Formulas are read; what the paper explains by figures are its ensembles.
    explained = {kind: students[kind] for kind in ("gbm", "ebm")}
    measured = []
    for kind, student in explained.items():
        samples = held_out_samples(source, kind, config.n_samples, seed)
        found = measure_importances(student, samples, seed=seed, repeats=config.repeats)
        measured.append(found.assign(policy=kind))
        drawn = student_figures(name, kind, student, JOINT, samples.observations, seed)
        Report(figures=drawn).write(folder)
    report = importance_report(name, pd.concat(measured, ignore_index=True))
    report.write(folder)
    tops = report.tables["top_observations"]
    _draw_sequences(gait, expert, students, folder)
    return GaitResults(name, folder, r2, standalone, tops[tops["student"] == "gbm"])


def _draw_sequences(
    gait: Gait, expert: NeuralPolicy, students: Mapping[str, Policy], folder: Path
) -> None:
    for kind, student in students.items():
        rollout = _roll_out_alone(gait, expert, student)
        title = f"{gait.name.capitalize()}, {student_title(kind)}"
        save_figure(gait_figure(rollout, gait, f"{title} alone"), folder / f"{kind}_sequence")
        if kind == "ebm":
            step = min(EXPLAINED_STEP, len(rollout.time) - 1)
            parts = student.explain(rollout["observations"][step], JOINT)
            local = contribution_figure(parts, f"{title}, FL hip, step {step}")
            save_figure(local, folder / f"{kind}_local")


def _roll_out_alone(gait: Gait, expert: NeuralPolicy, student: Policy) -> Rollout:
    command = FixedCommand(speed=min(SPEED, gait.max_speed))
    policy = alone(student, expert)
    diagram = MakeLocomotion(gait, Scenario(command=command), policy=policy)
    return record(make_simulator(diagram), round(SEQUENCE_SECONDS / CONTROL_PERIOD))
