"""`glassgait importance`: which observations each student uses (paper, Section IV-B)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar

from annotated_types import Ge
from joblib import delayed

from glassgait.diagrams.scenario import NOMINAL_SCENARIO
from glassgait.models.errors import InputError
from glassgait.models.policies.library import EXPERTS
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Count, checked
from glassgait.studies.common.console import progress_bar
from glassgait.studies.common.experiment import Case, Experiment, PolicyNames, Report
from glassgait.studies.common.jobs import run_parallel
from glassgait.studies.distillation.dataset import Dataset

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class SampledCase(Case):
    """A student with the samples for its importances."""

    samples: Dataset


@checked
class Importance(Experiment):
    """Measure which observations each student uses, and draw its trees and functions.

    Attributes:
        policy: Kinds of students, and paths of their files or of networks' descriptions; by default
            the available students of gbm, ebm, linear_per_state, symbolic, symbolic_per_state and
            formulas.
        joint: Joint whose trees and functions are drawn.
        n_samples: Greatest number of samples, from new episodes of each student.
        repeats: Shuffles of each observation.
    """

    title: ClassVar[str] = "importance"
    scenario: ClassVar[tuple[str, ...]] = (NOMINAL_SCENARIO,)

    policy: PolicyNames = (
        *("gbm", "ebm", "linear_per_state", "symbolic", "symbolic_per_state", "formulas"),
    )
    joint: str = "FL_hip"
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10

    def __post_init__(self) -> None:
        joint_index(self.joint)

    @cached_property
    def students(self) -> dict[str, Policy]:
        """The students by kind and networks of other projects; neural policies are refused."""
        students = self.acting(self.gaits[0].name)
        for kind, student in students.items():
            if student.kind in EXPERTS and not student.remembers:
                raise InputError(f"--policy {kind}: is neural; name a kind of student")
        return students

    def cases(self) -> list[Case]:
        """Lists the students; neural policies are refused before anything is measured."""
        _ = self.students
        return super().cases()

    @cached_property
    def samples(self) -> dict[str, Dataset]:
        """The samples of each student, shared by its measurement and figures."""
        from glassgait.studies.importance.study import visited_samples

        gait, students = self.gaits[0], self.students
        acting = self.controllers[gait.name].values()
        rest = self.n_samples, self.seed
        calls = (delayed(visited_samples)(gait, controller, *rest) for controller in acting)
        samples = {}
        with progress_bar(len(students)) as (progress, bar):
            for kind, data in zip(students, run_parallel(calls), strict=True):
                samples[kind] = data
                progress.update(bar, advance=1, text=f"samples of {kind}")
        return samples

    def prepared(self, cases: list[Case]) -> list[Case]:
        pairs = ((case, self.samples[case.labels["policy"]]) for case in cases)
        return [SampledCase(**vars(case), samples=samples) for case, samples in pairs]

    def measure(self, case: Case) -> pd.DataFrame:
        from glassgait.studies.importance.study import measure_importances

        assert isinstance(case, SampledCase)
        student = case.controller.policy
        return measure_importances(student, case.samples, seed=case.seed, repeats=self.repeats)

    def report(self, table: pd.DataFrame) -> Report:
        """Reports importances as maps and tables, and draws the students' models."""
        from glassgait.studies.importance.figures import student_figures
        from glassgait.studies.importance.study import importance_report

        gait = self.gaits[0].name
        report = importance_report(gait, table)
        joint, figures = joint_index(self.joint), dict(report.figures)
        for kind, student in self.students.items():
            observations = self.samples[kind].observations
            figures |= student_figures(gait, kind, student, joint, observations, self.seed)
        return replace(report, figures=figures)
