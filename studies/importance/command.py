"""`glassgait importance`: what each student looks at (paper, Section IV-B)."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
from annotated_types import Ge

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Count, checked
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, PolicyNames, Report
from glassgait.studies.common.run_folder import digest_of_files
from glassgait.studies.distillation.dataset import Dataset, round_paths
from glassgait.studies.distillation.students import STUDENTS, samples_folder
from glassgait.studies.importance.figures import student_figures
from glassgait.studies.importance.study import (
    held_out_samples,
    importance_report,
    measure_importances,
    visited_samples,
)

MEASURED = ("gbm", "ebm", "statewise_linear", "symbolic", "statewise_symbolic")
"""Kinds of students that are measured by default."""


@checked
class Importance(Experiment):
    """Measure which observations each student uses, and draw its trees and functions.

    Attributes:
        policy: Kinds of students, and paths of their files; by default those that there are of gbm,
            ebm, statewise_linear, symbolic and statewise_symbolic.
        joint: Joint whose trees and functions are drawn.
        n_samples: Samples that importances are measured on, at most; a student was fitted to none.
            They are those that a distillation held out or, of other students, new ones.
        repeats: Shuffles of each observation; the first seed is that of all shuffling.
    """

    title: ClassVar[str] = "importance"
    of_students: ClassVar[bool] = True
    scenario: ClassVar[tuple[str, ...]] = (TRAINING,)
    prepared: ClassVar[tuple[str, ...]] = ("samples",)
    inputs: ClassVar[Mapping[str, str]] = {"samples": "digest_of_rounds"}

    policy: PolicyNames = MEASURED
    joint: str = "FL_hip"
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10

    def __post_init__(self) -> None:
        joint_index(self.joint)

    @property
    def acting(self) -> dict[str, AlternatingController]:
        """The students, each alone, by kind."""
        return self.controllers[self.gaits[0].name]

    @cached_property
    def fitted_to(self) -> Path | None:
        """The folder whose samples the students were fitted to, if it is there."""
        folder = self.policies[self.gaits[0].name].folder
        if folder is None or not {*self.acting} <= {*STUDENTS}:
            return None
        kept = all(any(samples_folder(folder, kind).glob("round_*")) for kind in self.acting)
        return folder if kept else None

    @property
    def digest_of_rounds(self) -> str:
        """A digest of the samples that the students were fitted to."""
        folder = self.fitted_to
        if folder is None:
            return ""
        kept = (samples_folder(folder, kind) for kind in self.acting)
        return digest_of_files([path for own in kept for path in round_paths(own)])

    @cached_property
    def samples(self) -> dict[str, Dataset]:
        """Samples of each student that importances are measured on."""
        gait, folder, of = self.gaits[0], self.fitted_to, (self.n_samples, self.seed)
        if folder is not None:
            return {kind: held_out_samples(folder, kind, *of) for kind in self.acting}
        expert = self.policies[gait.name].expert
        return {
            kind: visited_samples(gait, expert, own.policy, *of)
            for kind, own in self.acting.items()
        }

    def measure(self, case: Case) -> pd.DataFrame:
        """Measures a student's importances by every method."""
        samples = self.samples[case.labels["policy"]]
        return measure_importances(case.alone.policy, samples, seed=self.seed, repeats=self.repeats)

    def report(self, table: pd.DataFrame) -> Report:
        """Reports importances as maps and tables, and draws the students from within."""
        gait, students = self.gaits[0].name, {kind: own.policy for kind, own in self.acting.items()}
        report = importance_report(gait, table)
        joint, figures = joint_index(self.joint), dict(report.figures)
        for kind, student in students.items():
            observations = self.samples[kind].observations
            figures |= student_figures(gait, kind, student, joint, observations, self.seed)
        return replace(report, figures=figures)
