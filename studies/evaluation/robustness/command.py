"""`glassgait evaluate worlds`: who falls in which world."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro
from annotated_types import MinLen

from glassgait.diagrams.scenario import Scenario, load_scenarios
from glassgait.models.errors import InputError
from glassgait.models.policies.library import shipped_experts, shipped_students
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import DISTINCT, FEW, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.jobs import inputs_of, run_jobs
from glassgait.studies.common.rollouts.worlds import world_jobs
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import (
    ALL_GAITS,
    Gaits,
    WorkersConfig,
    gaits_named,
    refuse_files_of_several,
    run_each,
)
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import load_shipped_students, load_students
from glassgait.studies.distillation.students.settings import StudentKind
from glassgait.studies.evaluation.robustness.figures import fall_map, fall_overview
from glassgait.studies.evaluation.robustness.tables import fall_table, readable_table, worst_table

OUTPUT = Path("runs/robustness")


@dataclass(frozen=True)
class Robustness(Settings):
    """Let the expert and every student walk alone in every scenario, and tell who falls where.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait whose expert ships, and
            of students that are named, any of those. Each gait has a run.
        students: Kinds of students; every one that there is by default.
        scenario: The scenarios: names of those that ship, or `all` of them, and paths of scenario
            files. `--worlds` is another name for it.
        rollouts: How robots are rolled out, at the speeds of distillation unless others are named.
        workers: Where rollouts run.
        distillation: Folder of a distillation whose students walk; those that ship by default.
        expert: Policy file of the expert, which without a distillation walks without students; the
            shipped one by default.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/robustness/<gait> by default.
    """

    title: ClassVar[str] = "robustness"

    gait: Gaits = ("trot",)
    students: Annotated[tuple[StudentKind, ...], FEW, DISTINCT] = ()
    scenario: Annotated[
        tuple[str, ...], MinLen(1), FEW, DISTINCT, tyro.conf.arg(aliases=("--worlds",))
    ] = ("all",)
    rollouts: Annotated[RolloutConfig, tyro.conf.arg(name="")] = field(
        default_factory=lambda: RolloutConfig(n_seeds=1)
    )
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study of every gait."""
        names, scenarios = self._gaits(), load_scenarios(self.scenario)
        if len(names) == 1:
            replace(self, gait=names)._run_one(scenarios)
            return
        folder = self.output or OUTPUT
        tables = {}

        def run_alone(name: str) -> None:
            gait = load_gait(name).name
            one = replace(self, gait=(name,), output=folder / gait)
            tables[gait] = one._run_one(scenarios)

        run_each(names, run_alone)
        _write_overview(tables, folder)
        console.print(f"all gaits side by side: {folder / 'worlds.png'}")

    def _run_one(self, scenarios: Mapping[str, Scenario]) -> pd.DataFrame:
        """Runs the study of the only gait."""
        gait = load_gait(self.gait[0])
        expert = find_expert(gait, self.expert)
        students = self._students(gait, expert)
        jobs = world_jobs(gait, expert, students, scenarios, self.rollouts)
        folder = self.output or OUTPUT / gait.name
        run = {"study": "evaluate worlds", "settings": self, "resume": self.resume}
        with (
            open_run(folder, **run, inputs=inputs_of(jobs)),
            parallel_backend(self.workers.backend),
        ):
            scores = run_jobs(jobs, folder / "rollouts", processes=self.workers.processes)
            titles = {name: scenario.title for name, scenario in scenarios.items()}
            table = fall_table(scores, titles)
            _write(table, gait, folder)
        print_table(f"{gait.name}: where each falls most", worst_table(table))
        console.print(f"written to {folder}")
        return table

    def _students(self, gait: Gait, expert: NeuralPolicy) -> dict[str, Policy]:
        """Loads the students that walk; where there are none, the expert walks alone."""
        if self.distillation:
            there = load_students(self.distillation, expert)
        else:
            # Those that ship observe with the estimator of the expert that ships.
            there = {} if self.expert else load_shipped_students(expert)
        students = {kind: own for kind, own in there.items() if kind in (self.students or there)}
        if self.students and not students:
            raise InputError(
                f"no student {', '.join(self.students)} of the {gait.name}: there are "
                f"{', '.join(there) or 'none'}; name others with --students, or their folder with "
                "--distillation"
            )
        missing = [kind for kind in self.students if kind not in students]
        if missing:
            say(f"{gait.name}: there is no student {', '.join(missing)}; the others walk")
        return students

    def _gaits(self) -> tuple[str, ...]:
        names = gaits_named(self.gait)
        refuse_files_of_several(names, self.expert, self.distillation)
        if ALL_GAITS not in self.gait:
            return names
        kinds = {*self.students}
        gaits = tuple(
            name for name in shipped_experts() if not kinds or kinds & {*shipped_students(name)}
        )
        if not gaits:
            raise InputError(
                f"no gait ships with a student {', '.join(self.students)}; name one gait and the "
                "--distillation that made it"
            )
        return gaits


def _write_overview(tables: Mapping[str, pd.DataFrame], folder: Path) -> None:
    """Writes the tables of all gaits as one, and their maps side by side."""
    parts = [readable_table(table).assign(gait=gait) for gait, table in tables.items()]
    whole = pd.concat(parts, ignore_index=True)
    write_table(whole[["gait", *whole.columns.drop("gait")]], folder / "worlds")
    save_figure(fall_overview(tables), folder / "worlds")


def _write(table: pd.DataFrame, gait: Gait, folder: Path) -> None:
    write_table(readable_table(table), folder / "worlds")
    write_metrics(table.to_dict(orient="records"), folder / "metrics.json")
    title = f"{gait.name.capitalize()}: who falls where, each policy alone, worst scenario first"
    save_figure(fall_map(table, title), folder / "worlds")
