"""`glassgait evaluate policies`: rolls policies out and scores them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro
from annotated_types import MinLen

from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenarios
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import shipped_experts, shipped_students
from glassgait.models.settings import DISTINCT, FEW, Settings
from glassgait.models.task.command import DEAD_BAND
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.rollouts.alternation import alternation_jobs
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.jobs import RolloutJob, finish_jobs, inputs_of, run_jobs
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import ALL_GAITS, Gaits, WorkersConfig, gaits_named, run_each
from glassgait.studies.common.tables import print_table
from glassgait.studies.distillation.students.library import (
    distillation_folder,
    find_student,
    load_students,
)
from glassgait.studies.evaluation.results import (
    write_alternation,
    write_scorecard,
    write_tracking,
)
from glassgait.studies.evaluation.scorecard import scorecard_jobs
from glassgait.studies.evaluation.tracking import follow, steady_jobs

ALL_SCENARIOS = ("all",)


@dataclass(frozen=True)
class Evaluate(Settings):
    """Roll policies out in closed loop and score them.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships with the
            policy. Experts, and students of a kind, of several gaits stand in one table.
        policy: `expert`; `students`, for those of a distillation at every alternation ratio, a run
            for each gait; or a kind of student or the path of its policy file, to be rolled out
            alone, at the speeds of distillation.
        scenario: Where to roll out: names of scenarios that ship, or `all` of them, and paths of
            scenario files; `students` are rolled out in one, the training scenario by default.
            `--worlds` is another name for it.
        rollouts: How robots are rolled out.
        workers: Where rollouts run.
        distillation: Folder of a distillation; runs/distillation/<gait> by default, and where that
            lacks a kind of student, the shipped one.
        expert: Policy file of the expert; by default the shipped one, or what was trained here.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/evaluation/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "evaluate"

    gait: Gaits = ("trot",)
    policy: str = "expert"
    scenario: Annotated[
        tuple[str, ...], MinLen(1), FEW, DISTINCT, tyro.conf.arg(aliases=("--worlds",))
    ] = ALL_SCENARIOS
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=RolloutConfig
    )
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study."""
        names = self._gaits()
        if self.policy != "students":
            scenarios = load_scenarios(self.scenario)
            self._score(self._scorecard(names, scenarios), scenarios)
            return
        scenarios = self._one_scenario()
        if len(names) == 1:
            self._score(self._alternation(names[0], *scenarios.values()), scenarios)
            return
        run_each(names, self._run_alone)

    def _run_alone(self, name: str) -> None:
        output = self.output / load_gait(name).name if self.output else None
        replace(self, gait=(name,), output=output).run()

    def _score(self, jobs: list[RolloutJob], scenarios: Mapping[str, Scenario]) -> None:
        name, gaits = Path(self.policy).stem, "_".join(Path(name).stem for name in self.gait)
        folder = self.output or Path("runs/evaluation") / gaits / name
        with (
            open_run(
                folder,
                study="evaluate policies",
                settings=self,
                inputs=inputs_of(jobs),
                resume=self.resume,
            ),
            parallel_backend(self.workers.backend),
        ):
            scores = run_jobs(jobs, folder / "rollouts", processes=self.workers.processes)
            table = self._write(scores, scenarios, folder)
            told = self._follow(jobs, folder, f"{gaits}: {name}")
        print_table(f"{gaits}: {name}", table)
        console.print(
            f"drawn speeds below {DEAD_BAND:g} m/s are commands to stand, which the speed error "
            "leaves out"
        )
        for title, tracking in told.items():
            print_table(title, tracking)
        console.print(f"written to {folder}")

    def _follow(
        self, jobs: Sequence[RolloutJob], folder: Path, title: str
    ) -> dict[str, pd.DataFrame]:
        """Measures how steady commands are followed; not in continuous worlds, which take long."""
        steady = steady_jobs(jobs, self.rollouts)
        if not steady:
            return {}
        processes = self.workers.processes
        rows = finish_jobs(steady, follow, folder / "steady", processes=processes)
        title = f"{title}: commanded and measured, {steady[0].scenario.title}"
        return {title: write_tracking(rows, title, folder)}

    def _write(
        self, scores: pd.DataFrame, scenarios: Mapping[str, Scenario], folder: Path
    ) -> pd.DataFrame:
        if self.policy == "students":
            return write_alternation(scores, load_gait(self.gait[0]).name, folder)
        titles = {name: scenario.title for name, scenario in scenarios.items()}
        return write_scorecard(scores, titles, folder)

    def _one_scenario(self) -> dict[str, Scenario]:
        named = (TRAINING,) if self.scenario == ALL_SCENARIOS else self.scenario
        scenarios = load_scenarios(named)
        if len(scenarios) > 1:
            raise InputError(
                f"--policy students is rolled out in one scenario, not in {len(scenarios)}; name "
                "one with --scenario"
            )
        return scenarios

    def _alternation(self, name: str, scenario: Scenario) -> list[RolloutJob]:
        gait = load_gait(name)
        expert = find_expert(gait, self.expert)
        students = load_students(self.distillation or distillation_folder(gait.name), expert)
        return alternation_jobs(gait, expert, students, self.rollouts, scenario=scenario)

    def _scorecard(
        self, names: Sequence[str], scenarios: Mapping[str, Scenario]
    ) -> list[RolloutJob]:
        policies = [self._policy(load_gait(name)) for name in names]
        return scorecard_jobs(policies, scenarios, self.rollouts)

    def _gaits(self) -> tuple[str, ...]:
        names = gaits_named(self.gait)
        if (len(names) > 1) and (self.expert or self.distillation or "." in self.policy):
            raise InputError(
                "--gait: several gaits take no files of your own; name one gait for them"
            )
        if ALL_GAITS not in self.gait:
            return names
        own = ("expert", "students")
        shipped = {name: (*own, *shipped_students(name)) for name in shipped_experts()}
        gaits = tuple(name for name, policies in shipped.items() if self.policy in policies)
        if not gaits:
            raise InputError(f"no gait ships with a policy {self.policy!r}; name one gait")
        return gaits

    def _policy(self, gait: Gait) -> tuple[Gait, AlternatingController]:
        expert = find_expert(gait, self.expert)
        if self.policy == "expert":
            return gait, alone(expert)
        student = find_student(self.policy, expert, self.distillation)
        return gait, alone(student, expert)
