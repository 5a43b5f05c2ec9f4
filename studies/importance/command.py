"""`glassgait importance`: which observations each student uses (paper, Section IV-B)."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from annotated_types import Ge

from glassgait.diagrams.scenario import NOMINAL_SCENARIO
from glassgait.models.errors import InputError
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Count, checked
from glassgait.studies.common.experiment import Case, Experiment, PolicyNames, Report
from glassgait.studies.distillation.dataset import Dataset
from glassgait.studies.distillation.students import STUDENTS, samples_folder

if TYPE_CHECKING:
    import pandas as pd


@checked
class Importance(Experiment):
    """Measure which observations each student uses, and draw its trees and functions.

    Attributes:
        policy: Kinds of students, and paths of their files; by default those that there are of gbm,
            ebm, linear_per_state, symbolic and symbolic_per_state.
        joint: Joint whose trees and functions are drawn.
        n_samples: Samples that importances are measured on, at most; a student was fitted to none.
            They are those that a distillation held out or, of other students, new ones.
        repeats: Shuffles of each observation; the first seed is that of all shuffling.
    """

    title: ClassVar[str] = "importance"
    scenario: ClassVar[tuple[str, ...]] = (NOMINAL_SCENARIO,)

    policy: PolicyNames = ("gbm", "ebm", "linear_per_state", "symbolic", "symbolic_per_state")
    joint: str = "FL_hip"
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10

    def __post_init__(self) -> None:
        joint_index(self.joint)

    @cached_property
    def students(self) -> dict[str, Policy]:
        """The students by kind; neural policies are refused."""
        controllers = self.controllers[self.gaits[0].name]
        found = {kind: acting.policy for kind, acting in controllers.items()}
        for kind, policy in found.items():
            if isinstance(policy, NeuralPolicy):
                raise InputError(f"--policy {kind}: is neural; name a kind of student")
        return found

    @cached_property
    def fitted_to(self) -> Path | None:
        """The folder whose samples the students were fitted to, if it is there."""
        from glassgait.studies.common.policies import SHIPPED

        place = self.policies[self.gaits[0].name].place
        if place == SHIPPED or not {*self.students} <= {*STUDENTS}:
            return None
        folder = Path(place)
        kept = all(any(samples_folder(folder, kind).glob("round_*")) for kind in self.students)
        return folder if kept else None

    def cases(self) -> list[Case]:
        """Lists the students; neural policies are refused before anything is measured."""
        _ = self.students
        return super().cases()

    def samples(self, kind: str) -> Dataset:
        """Returns the samples of a student that importances are measured on."""
        from glassgait.studies.importance.study import held_out_samples, visited_samples

        gait, folder, of = self.gaits[0], self.fitted_to, (self.n_samples, self.seed)
        if folder is not None:
            return held_out_samples(folder, kind, *of)
        expert = self.policies[gait.name].expert
        return visited_samples(gait, expert, self.students[kind], *of)

    def measure(self, case: Case) -> pd.DataFrame:
        """Measures a student's importances by every method."""
        from glassgait.studies.importance.study import measure_importances

        kind = case.labels["policy"]
        student, samples = self.students[kind], self.samples(kind)
        return measure_importances(student, samples, seed=self.seed, repeats=self.repeats)

    def report(self, table: pd.DataFrame) -> Report:
        """Reports importances as maps and tables, and draws the students from within."""
        from glassgait.studies.importance.figures import student_figures
        from glassgait.studies.importance.study import importance_report

        gait = self.gaits[0].name
        report = importance_report(gait, table)
        joint, figures = joint_index(self.joint), dict(report.figures)
        for kind, student in self.students.items():
            observations = self.samples(kind).observations
            figures |= student_figures(gait, kind, student, joint, observations, self.seed)
        return replace(report, figures=figures)
