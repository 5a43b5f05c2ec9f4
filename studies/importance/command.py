"""`glassgait importance`: what each student looks at, and whether that is true."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
from annotated_types import Ge

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots.quadruped import joint_index
from glassgait.models.settings import Count
from glassgait.studies.common.cases import Case, not_finite_lines, score
from glassgait.studies.common.experiment import PolicyNames, Report, RolloutExperiment
from glassgait.studies.common.run_folder import digest_of_files
from glassgait.studies.distillation.students.baselines import STATEWISE_LINEAR
from glassgait.studies.distillation.students.boosting import EBM, GBM
from glassgait.studies.distillation.students.dataset import Dataset, round_paths
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.registry import STUDENTS, policy_title
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC
from glassgait.studies.importance.faithfulness import (
    MODE_TITLES,
    WHOLE,
    AblatedController,
    losses,
    rank_correlations,
)
from glassgait.studies.importance.figures import faithfulness_figure, loss_figure, student_figures
from glassgait.studies.importance.measures import METHOD_TITLES, observation_groups
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
class Importance(RolloutExperiment):
    """Measure what each student looks at, and take it away to see whether that is true.

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
    axes: ClassVar[Mapping[str, str]] = {"without": "groups", "mode": "modes"}
    modes: ClassVar[tuple[str, ...]] = tuple(MODE_TITLES)
    prepared: ClassVar[tuple[str, ...]] = ("means",)
    inputs: ClassVar[Mapping[str, str]] = {"samples": "digest_of_rounds"}

    policy: PolicyNames = MEASURED
    n_robots: Count = 13
    n_steps: Count = 500
    joint: str = "FL_hip"
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        joint_index(self.joint)

    @property
    def acting(self) -> dict[str, AlternatingController]:
        """The students, each alone, by kind."""
        return self.controllers[self.gaits[0].name]

    @property
    def groups(self) -> tuple[str, ...]:
        """What is taken away: nothing, and each group of observations."""
        names = next(iter(self.acting.values())).expert.observation_names
        return WHOLE, *observation_groups(names)

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

    @cached_property
    def means(self) -> dict[str, Array]:
        """Means of each student's observations."""
        return {kind: own.observations.mean(axis=0) for kind, own in self.samples.items()}

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls a student out alone, whole or without a group of observations."""
        kind, without, mode = (case.labels[name] for name in ("policy", "without", "mode"))
        controller = case.controller
        if without != WHOLE:
            columns = observation_groups(case.controller.expert.observation_names)[without]
            controller = AblatedController(
                case.controller,
                columns=tuple(columns.tolist()),
                mode=mode,
                means=tuple(self.means[kind][columns].tolist()),
            )
        elif mode != self.modes[0]:
            return pd.DataFrame()
        return score(replace(case, controller=controller, config=self.rollouts(case)))

    def report(self, table: pd.DataFrame) -> Report:
        """Reports importances, what is lost without each group, and how far both agree."""
        gait, students = self.gaits[0].name, {kind: own.policy for kind, own in self.acting.items()}
        importances, _, found = measure_importances(
            gait, students, self.samples, seed=self.seed, repeats=self.repeats
        )
        joint, title = joint_index(self.joint), gait.capitalize()
        figures = {}
        for kind, student in students.items():
            observations = self.samples[kind].observations
            figures |= student_figures(gait, kind, student, joint, observations, self.seed)
        lost = losses(table)
        correlations = rank_correlations(importances, lost)
        figures["losses"] = loss_figure(lost, title)
        figures["faithfulness"] = faithfulness_figure(importances, lost, title)
        measured = {"importances": importances, "losses": lost, "faithfulness": correlations}
        return found.joined(
            Report(
                tables={"losses": lost, "faithfulness": correlations},
                metrics={name: own.to_dict(orient="records") for name, own in measured.items()},
                figures=figures,
                shown={
                    f"{gait}: rank correlation of importance and loss": readable_table(correlations)
                },
                lines=[*COLUMNS, *not_finite_lines(table)],
            )
        )


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
