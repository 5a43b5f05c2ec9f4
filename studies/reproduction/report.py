"""`glassgait reproduce report` and `reproduce paper`: the paper's tables and figures."""

import time
from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
import tyro
from annotated_types import Ge, MinLen

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.settings import DISTINCT, FEW, Count, Natural, Settings, checked
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import check_reported_seeds
from glassgait.studies.common.figures import gait_figure, save_figure
from glassgait.studies.common.jobs import Gaits, Job, Workers, expand_gaits, run_jobs
from glassgait.studies.common.policies import find_policies
from glassgait.studies.common.rollouts import CommandOverride, RolloutConfig
from glassgait.studies.common.run import default_folder, open_run
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students import load_students, paper_students
from glassgait.studies.distillation.study import distill, write_r2_table
from glassgait.studies.distillation.symbolic import Engine, pysr_starts
from glassgait.studies.evaluation.alternation import PERIODS, alternation_report, alternation_scores
from glassgait.studies.evaluation.tables import standalone_table
from glassgait.studies.importance.figures import contribution_figure, student_figures
from glassgait.studies.importance.study import (
    held_out_samples,
    importance_report,
    measure_importances,
)
from glassgait.studies.reproduction.contents import GaitResults, contents, r2_by_gait
from glassgait.studies.reproduction.page import Section, write_page
from glassgait.studies.training.command import train_job
from glassgait.studies.training.config import TrainingConfig

PAPER_GAITS = ("walk", "trot", "pace", "bound")

JOINT = 0  # of the paper's single-joint figures, FL hip
SEQUENCE_STEPS = 200
EXPLAINED_STEP = 100

WITHOUT_PYSR = (
    "Formulas are searched by Operon, not by PySR: operators, nodes and iterations are counted in "
    "another way, and there is no cube."
)


@checked
class Report(Settings):
    """Distil, evaluate and explain experts, and write one report beside the paper.

    `reproduce report` reads studies/reproduction/report.yaml and uses the shipped experts.
    `reproduce paper` reads paper.yaml, the paper's settings, and trains experts for days.

    Attributes:
        gait: Names of gaits; `all` for every shipped gait. A resumed run may name other gaits.
        training: Settings of the training; without them, the shipped experts are used.
        distillation: Settings of the distillation.
        periods: Control steps between two actions of the expert, for each alternation ratio; 0 for
            the student only.
        rollouts: Settings of the rollouts.
        n_samples: Held-out samples for the importances.
        repeats: Shuffles of each observation.
        engine: Engine of symbolic regression, instead of the one in the settings. PySR needs Julia.
        robot: Name of a robot, or path of its robot.yaml; by default the robot of the shipped
            policies. For another robot, `report` uses experts that you trained.
        quick: Use the smaller settings under the file's key `quick`.
        workers: Workers that study the gaits in parallel.
        resume: Continue the run in the folder.
        output: Folder of the report; by default runs/reproduce/report or runs/reproduce/paper, with
            --quick followed by _quick.
    """

    title: ClassVar[str] = "reproduce report"

    gait: Gaits = PAPER_GAITS
    training: Annotated[TrainingConfig | None, tyro.conf.Fixed, tyro.conf.AvoidSubcommands] = None
    distillation: Annotated[DistillationConfig, tyro.conf.Fixed] = field(
        default_factory=lambda: DistillationConfig(students=paper_students())
    )
    periods: Annotated[tuple[Natural, ...], MinLen(1), FEW, DISTINCT] = PERIODS
    rollouts: Annotated[RolloutConfig, tyro.conf.Fixed] = field(default_factory=RolloutConfig)
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10
    engine: Engine | None = None
    robot: str | None = None
    quick: bool = False
    workers: Annotated[Workers, tyro.conf.arg(name="")] = field(default_factory=Workers)
    resume: bool = False
    output: Path | None = None

    def __post_init__(self) -> None:
        """Refuses settings with which a table or figure of the paper would be missing."""
        check_reported_seeds(self.rollouts.seeds)
        if missing := sorted({*paper_students()} - {*self.distillation.students}):
            raise InputError(f"{self.title}: distillation.students lacks {missing[0]}; add it")
        if self.distillation.settings.ebm.interactions == 0:
            raise InputError(f"{self.title}: interactions of the ebm is 0; Figure 8 shows one")
        if {*self.periods} == {1}:
            raise InputError(f"{self.title}: no student acts at a period of 1; add another period")

    @property
    def study(self) -> str:
        """Name of the study in a run's record."""
        return "reproduce report" if self.training is None else "reproduce paper"

    @cached_property
    def _robot(self) -> Robot:
        return load_robot(self.robot or DEFAULT_ROBOT)

    def run(self) -> None:
        """Studies every gait, then writes report.html."""
        started, names, report = time.monotonic(), expand_gaits(self.gait), self.settled()
        folder = self.output or default_folder(self.study + "_quick" * self.quick, self._robot.name)
        claim = {"study": self.study, "settings": report, "inputs": self._inputs(names)}
        # A continued run may name other gaits.
        jobs = [Job(name, 0, folder / load_gait(name).name) for name in names]
        run = open_run(folder, **claim, resume=self.resume, free=("gait",))
        with run, self.workers.pool():
            results = run_jobs(jobs, partial(study_gait, report))
            path = report.write(results, folder)
        print_table("R²", r2_by_gait(results))
        minutes = (time.monotonic() - started) / 60
        console.print(f"report written to {path} after {minutes:.1f} minutes")

    def settled(self) -> "Report":
        """Returns the settings with the options --engine and --robot applied."""
        distillation, training = self.distillation, self.training
        if self.engine is not None:
            symbolic = replace(distillation.settings.symbolic, engine=self.engine)
            settings = replace(distillation.settings, symbolic=symbolic)
            distillation = replace(distillation, settings=settings)
        if training is not None and self.robot is not None:
            training = replace(training, robot=self.robot)
        report = replace(self, distillation=distillation, training=training, engine=None)
        if report.distillation.settings.symbolic.engine == "pysr" and not pysr_starts():
            raise InputError(
                f"{self.title}: the engine 'pysr' needs Julia, which could not be started here; "
                "install Julia, or use --engine operon"
            )
        return report

    def rollouts_of(self, gait: Gait) -> RolloutConfig:
        """Returns the settings of a gait's rollouts, with speeds limited to the gait's range."""
        if self.rollouts.speed_range is None:
            return self.rollouts
        slowest, fastest = np.clip(self.rollouts.speed_range, -gait.max_speed, gait.max_speed)
        return replace(self.rollouts, speed_range=(float(slowest), float(fastest)))

    def expert(self, name: str, folder: Path) -> Policy:
        """Trains the expert of a gait if there are settings for it; otherwise loads it."""
        gait = load_gait(name)
        if self.training is None:
            return find_policies(gait, robot=self.robot, quiet=True).expert
        trained = folder / "training"
        say(f"{gait.name}: training the expert")
        train_job(self.training, Job(name, self.training.seed, trained), resume=True)
        return load_expert(gait, trained / f"{gait.name}.safetensors", self._robot)

    def deviations(self) -> list[str]:
        """Lists the differences from the paper."""
        shipped = "The experts ship with GlassGait; the paper's settings did not train them."
        return [
            *[shipped] * (self.training is None),
            *[WITHOUT_PYSR] * (self.distillation.settings.symbolic.engine == "operon"),
            f"The robot is a {self._robot.full_name} in Drake. studies/training/README.md and "
            "studies/distillation/README.md list differences in robot, task and methods.",
            "config.yaml has this run's settings; studies/reproduction/paper.yaml the paper's.",
        ]

    def write(self, results: Sequence[GaitResults], folder: Path) -> Path:
        """Writes the page and its tables, and returns the path of the page."""
        # Each table and figure has a file too, by the paper's number.
        sections = contents(results)
        for section in sections:
            stem = section.number.lower().replace(", ", "_").replace(" ", "_")
            for place, (_, table) in enumerate(section.tables, start=1):
                write_table(table, folder / f"{stem}_{place}")
            for _, picture in section.figures:
                name = f"{stem}_{picture.parent.name}_{picture.name}"
                write_atomically(folder / name, picture.read_bytes())

        # The page begins with a summary and the differences.
        rollouts, distillation = self.rollouts, self.distillation
        quick = "; the quick setting is for looking, not for quoting" * self.quick
        lead = (
            "Distilling Reinforcement Learning Policies for Interpretable Robot Locomotion "
            f"(Acero and Li), on Drake: {', '.join(found.gait for found in results)}. For each "
            f"gait {distillation.episodes} episodes of {distillation.episode_steps} control steps "
            f"were distilled, and {rollouts.n_robots * rollouts.n_seeds} robots rolled out for "
            f"{rollouts.n_steps} steps{quick}."
        )
        differs = Section("Where this differs from the paper", points=self.deviations())
        title = "The paper's tables and figures, made anew"
        return write_page(folder, title, [lead], [differs, *sections])

    def _inputs(self, names: Sequence[str]) -> dict[str, str]:
        if self.training is not None:
            return {f"gait {name}": load_gait(name).digest() for name in names}
        found = {name: find_policies(load_gait(name), robot=self.robot) for name in names}
        return {f"expert of the {name}": each.expert.digest() for name, each in found.items()}


def study_gait(report: Report, job: Job) -> GaitResults:
    """Trains or loads an expert, then distils, evaluates and explains it, resuming earlier work."""
    gait, folder = load_gait(job.gait), job.folder
    name, title = gait.name, gait.name.capitalize()
    expert, rollouts = report.expert(job.gait, folder), report.rollouts_of(gait)

    # Section III-C of the paper: students, and their R² (Table II).
    source = folder / "distillation"
    r2 = distill(replace(report.distillation, gait=job.gait), gait, expert, source, resume=True)
    write_r2_table(r2, name, source)
    students = load_students(source, expert)

    # Section IV-A: returns against the alternation ratio (Figure 2).
    say(f"{title}: rolling out every student at every alternation ratio")
    kept = folder / "rollouts"
    scores = alternation_scores(gait, expert, students, rollouts, kept, report.periods)
    policies = {"expert": expert, **students}
    alternation_report(scores, title, policies).write(folder)
    standalone = standalone_table(scores, policies)

    # Section IV-B: importances and explanations of the ensembles (Table I, Figures 6 to 11).
    seed = rollouts.seed
    explained = {kind: students[kind] for kind in ("gbm", "ebm")}
    measured = []
    for kind, student in explained.items():
        samples = held_out_samples(source, kind, report.n_samples, seed)
        found = measure_importances(student, samples, seed=seed, repeats=report.repeats)
        measured.append(found.assign(policy=kind))
        drawn = student_figures(name, kind, student, JOINT, samples.observations, seed)
        for stem, figure in drawn.items():
            save_figure(figure, folder / stem)
    importances = importance_report(name, pd.concat(measured, ignore_index=True))
    importances.write(folder)
    tops = importances.tables["top_observations"]

    # Gait sequences of every student (Figures 3 to 5), and a local explanation (Figure 9).
    scenario = Scenario(command=CommandOverride().override(gait))
    for kind, student in students.items():
        diagram = MakeLocomotion(gait, scenario, policy=alone(student, expert))
        rollout = record(make_simulator(diagram), SEQUENCE_STEPS)
        drawn, seconds = f"{title}, {kind}", rollout.time[-1]
        save_figure(gait_figure(rollout, gait, drawn, seconds), folder / f"{kind}_sequence")
        if kind == "ebm":
            step = min(EXPLAINED_STEP, len(rollout.time) - 1)
            parts = student.explain(rollout["observation"][step], JOINT)
            local = contribution_figure(parts, f"{drawn}, FL hip, step {step}")
            save_figure(local, folder / f"{kind}_local")
    return GaitResults(name, folder, r2, standalone, tops[tops["student"] == "gbm"])
