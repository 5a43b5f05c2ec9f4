"""`glassgait reproduce report` and `reproduce paper`: the paper's tables and figures, made anew."""

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import field, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import DISTINCT, FEW, checked
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.jobs import Gaits, Job, SweepConfig, gaits_named, run_sweep
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.run import default_folder, open_run
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.students import StudentKind
from glassgait.studies.distillation.symbolic import Engine, pysr_starts
from glassgait.studies.reproduction.contents import (
    WITHOUT_PYSR,
    contents,
    deviations,
    r2_by_gait,
)
from glassgait.studies.reproduction.gait import PAPER_GAITS, GaitResults, ReportConfig, study_gait
from glassgait.studies.reproduction.page import Section, write_page
from glassgait.studies.reproduction.settings import differences, load_settings, settings_file
from glassgait.studies.training.command import train_job
from glassgait.studies.training.config import TrainingConfig


@checked
class Report(ReportConfig):
    """Distil, evaluate and explain experts, and write one report beside the paper.

    The settings stand in studies/reproduction/report.yaml, which takes the experts that ship, and
    in paper.yaml, the paper's own, which trains them: that takes days, of which --resume loses
    minutes. --quick does less of everything, to see that all runs.

    Attributes:
        gait: Names of gaits; `all` for every gait that ships. A continued run may name others.
        training: How experts learn, the gait set for each; by default those that ship are taken.
        policy: Kinds of students beside the paper's.
        engine: What searches the formulas, in place of the settings' engine. PySR, the paper's,
            needs Julia and is refused where there is none; with `operon` the report says so.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies that
            ship. Of another robot your own experts are taken, or trained.
        quick: Do what the settings file names under `quick` instead.
        sweep: How many seeds of distillation, and where their gaits are studied.
        resume: Continue the run that the folder holds.
        output: Folder of the report; runs/reproduce/report by default, of the paper's settings
            runs/reproduce/paper, with --quick followed by _quick. Of several seeds each has a
            report in its folder seed_<seed>.
    """

    title: ClassVar[str] = "reproduce report"

    gait: Gaits = PAPER_GAITS
    training: Annotated[TrainingConfig | None, tyro.conf.Fixed] = None
    policy: Annotated[tuple[StudentKind, ...], FEW, DISTINCT] = ()
    engine: Engine | None = None
    robot: str | None = None
    quick: bool = False
    sweep: Annotated[SweepConfig, tyro.conf.arg(name="")] = field(default_factory=SweepConfig)
    resume: bool = False
    output: Path | None = None

    @property
    def study(self) -> str:
        """What a run's record calls the study."""
        return "reproduce report" if self.training is None else "reproduce paper"

    @cached_property
    def _robot(self) -> Robot:
        return load_robot() if self.robot is None else load_robot(self.robot)

    def run(self) -> None:
        """Runs every study, then writes report.html."""
        names = gaits_named(self.gait)
        inputs = self._inputs(names)
        started = time.monotonic()
        reports = self._reports()
        with ExitStack() as runs:
            for folder, own in reports.items():
                of = {"study": self.study, "inputs": inputs, "resume": self.resume}
                runs.enter_context(open_run(folder, settings=own, free=("gait",), **of))
            results = _study(names, reports)
            for folder, own in reports.items():
                path = own._write(results[folder], folder)
                print_table("R²", r2_by_gait(results[folder]))
                console.print(f"report written to {path}")
        console.print(f"after {(time.monotonic() - started) / 60:.1f} minutes")

    def _write(self, results: Sequence[GaitResults], folder: Path) -> Path:
        """Writes the page, and the tables on it."""
        gaits = [found.gait for found in results]
        sections = contents(results)
        for section in sections:
            for place, (_, table) in enumerate(section.tables, start=1):
                stem = section.number.lower().replace(" ", "_")
                write_table(table, folder / f"{stem}_{place}")
        rollouts, distillation = self.rollouts, self.distillation
        quick = "; the quick setting is for looking, not for quoting" * self.quick
        lead = (
            "Distilling Reinforcement Learning Policies for Interpretable Robot Locomotion "
            f"(Acero and Li), on Drake: {', '.join(gaits)}. For each gait {distillation.episodes} "
            f"episodes of {distillation.episode_steps} control steps were distilled, and "
            f"{rollouts.n_robots * rollouts.n_seeds} robots rolled out for {rollouts.n_steps} "
            f"steps{quick}."
        )
        differs = Section("Where this differs from the paper", points=self.deviations(folder))
        title = "The paper's tables and figures, made anew"
        return write_page(folder, title, [lead], [differs, *sections])

    def deviations(self, folder: Path) -> tuple[str, ...]:
        """Lists what differs from the paper: by nature and, where all is done anew, by settings.

        Differences in settings are printed, and written to the folder.
        """
        by_nature = deviations(self._robot, trains=self.training is not None)
        if self.training is None:
            return by_nature
        less = differences(load_settings(Report, settings_file("paper")), self)
        write_table(less, folder / "differences")
        if len(less):
            print_table("Not as in paper.yaml", less)
        here = [
            f"{row['setting']}: {row['here']}, not {row['in full']}." for _, row in less.iterrows()
        ]
        engine = (WITHOUT_PYSR,) if self._searches_by() == "operon" else ()
        return (*here, *engine, *by_nature)

    def settled(self) -> "Report":
        """Returns the settings with the engine, robot and further students that flags name.

        Raises:
            InputError: if formulas are PySR's, and Julia could not be started.
        """
        own = self.distillation
        students = tuple(dict.fromkeys((*own.students, *self.policy)))
        settings = own.settings
        if self.engine is not None:
            symbolic = replace(settings.of("symbolic"), engine=self.engine)
            settings = replace(settings, **{"symbolic": symbolic})
        distillation = replace(own, students=students, settings=settings)
        training = self.training
        if training is not None and self.robot is not None:
            training = replace(training, robot=self.robot)
        changed = {"distillation": distillation, "training": training}
        report = replace(self, **changed, policy=(), engine=None)
        if report._searches_by() == "pysr" and not pysr_starts():
            raise InputError(
                f"{self.title}: formulas are PySR's, which needs Julia, and Julia could not be "
                "started here; install it, or take Operon in place of PySR with --engine operon"
            )
        return report

    def _searches_by(self) -> str | None:
        """Returns what searches the formulas; None where there are none."""
        settings = self.distillation.settings.of("symbolic")
        return vars(settings)["engine"] if "symbolic" in self.distillation.students else None

    def _inputs(self, names: Sequence[str]) -> dict[str, str]:
        if self.training is not None:
            return {f"gait {name}": load_gait(name).digest() for name in names}
        found = {name: find_policies(load_gait(name), robot=self.robot) for name in names}
        return {f"expert of the {name}": own.expert.digest() for name, own in found.items()}

    def expert(self, name: str, trained: Path | None = None) -> NeuralPolicy:
        """Returns the expert of a gait: that of a run of its own, or the one that a user has."""
        gait = load_gait(name)
        if trained is not None:
            return load_expert(gait, trained / f"{gait.name}.safetensors", self._robot)
        return find_policies(gait, robot=self.robot, quiet=True).expert

    def _reports(self) -> dict[Path, "Report"]:
        """Returns the settings of each seed's report by its folder."""
        report, root = self.settled(), self.output
        if root is None:
            root = default_folder(self.study + "_quick" * self.quick, self._robot.name)
        if self.sweep.n_seeds == 1:
            return {root: report}
        own = report.distillation
        return {
            root / f"seed_{seed}": replace(report, distillation=replace(own, seed=seed))
            for seed in range(own.seed, own.seed + self.sweep.n_seeds)
        }


def _study(names: Sequence[str], reports: Mapping[Path, Report]) -> dict[Path, list[GaitResults]]:
    """Studies every gait for every report, and returns the results by the report's folder."""
    jobs = [
        Job(
            name,
            reports[folder].distillation.seed,
            folder / load_gait(name).name,
            f"{folder}: {name}",
        )
        for folder, name in product(reports, names)
    ]
    sweep = next(iter(reports.values())).sweep
    if len(jobs) == 1 and sweep.backend == "loky":
        found = iter([_study_job(reports, jobs[0])])
    else:
        found = iter(run_sweep(jobs, partial(_study_job, reports), sweep))
    return {folder: [next(found) for _ in names] for folder in reports}


def _study_job(reports: Mapping[Path, Report], job: Job) -> GaitResults:
    """Trains the expert of a gait, if it is to be, and studies it, from where the job stopped."""
    report, trained = reports[job.folder.parent], None
    if report.training is not None:
        trained = job.folder / "training"
        say(f"{job.title}: training the expert")
        train_job(
            report.training, Job(job.gait, report.training.seed, trained, job.title), resume=True
        )
    return study_gait(job.gait, report.expert(job.gait, trained), report, job.folder)
