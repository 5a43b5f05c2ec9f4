"""`glassgait reproduce`: does what a paper did, by the paper's own settings."""

import time
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import pandas as pd
import tyro

from glassgait.models.errors import InputError
from glassgait.models.robots.robot import load_robot
from glassgait.models.settings import Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import Job, WorkersConfig, gaits_named, run_sweep
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.distillation.students.symbolic_regression import Engine, pysr_starts
from glassgait.studies.reproduction.config import (
    ReproduceConfig,
    differences,
    load_settings,
    settings_file,
)
from glassgait.studies.reproduction.report.command import write_report
from glassgait.studies.reproduction.report.contents import r2_by_gait
from glassgait.studies.reproduction.report.gait import GaitResults, study_gait
from glassgait.studies.training.command import train_job

DEVIATIONS = (
    f"The robot is a {load_robot().full_name} in Drake, SAP contact at 10 ms, "
    "on flat ground; the paper's stands in IsaacGym. What else differs in robot and task is "
    "listed in studies/training/README.md.",
    "Friction differs between 16 groups of robots while experts learn, not between all robots.",
    "In distillation and rollouts an episode ends where the trunk is below 0.20 m or an action "
    "changes by more than 60 squared; while experts learn, at the reference code's 0.25 m and 40.",
    "The walk is asked for at most 0.5 m/s, so its episodes of 0.75 m/s ask for 0.5.",
    "A robot that falls while samples are collected starts again, and its episode goes on.",
    "Students that act are fitted to four of five episodes, whole ones; R² by the paper's split, "
    "which shuffles steps, is of another fit to the same episodes.",
    "While n is 1 the expert acts at every step, so students are first fitted after that.",
    "Explainable boosting takes the machine's state, which is 0 or 1, for a number. Trees and "
    "tables are rounded to single precision, numbers in formulas to three digits.",
    "Gait sequences are drawn as contacts over time, not as stills.",
)
"""What a reproduction does otherwise than the paper, whatever its settings."""

WITHOUT_PYSR = (
    "Formulas are searched by Operon, not by PySR: operators, nodes and iterations are counted "
    "otherwise, there is no cube, and what a function is applied to has no bound of its own. Their "
    "numbers are not the paper's method's."
)


@dataclass(frozen=True)
class Reproduce(Settings):
    """Do what the paper did by its own settings: train, distil, evaluate and explain.

    The settings stand in studies/reproduction/paper.yaml, with a comment for each. In full this
    takes days, of which --resume loses minutes; --quick does less of everything, and prints what.

    Attributes:
        settings: `paper`, or the path of a settings file of one's own.
        quick: Do what the settings name under `quick` instead: minutes, to see that all runs.
        engine: What searches the formulas, in place of the settings' engine. PySR, the paper's,
            needs Julia and is refused where there is none; with `operon` the report says so.
        workers: Where gaits are studied.
        resume: Continue the run that the folder holds.
        output: Folder of the run; runs/reproduce/<settings>, or <settings>_quick, by default.
    """

    title: ClassVar[str] = "reproduce"

    settings: Annotated[str, tyro.conf.Positional] = "paper"
    quick: bool = False
    engine: Engine | None = None
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs every study of every gait, then writes report.html and report.md."""
        path = settings_file(self.settings)
        full, config = load_settings(path), load_settings(path, quick=self.quick)
        if self.engine is not None:
            config = config.with_engine(self.engine)
        gaits_named(config.gaits)
        if config.engine == "pysr" and not pysr_starts():
            raise InputError(
                f"{path}: its formulas are PySR's, which needs Julia, and Julia could not be "
                "started here; install it, or take Operon in place of PySR with --engine operon"
            )
        started = time.monotonic()
        folder = self.output or Path("runs/reproduce") / (path.stem + "_quick" * self.quick)
        inputs = {f"gait {name}": load_gait(name).digest() for name in config.gaits}
        with open_run(
            folder, study="reproduce", settings=config, inputs=inputs, resume=self.resume
        ):
            less = differences(full, config)
            write_table(less, folder / "differences")
            if len(less):
                print_table(f"Not as in {path.name}", less)
            results = _study_gaits(config, folder, self.workers)
            write_report(
                results, config, folder, deviations=_deviations(config, less), quick=self.quick
            )
        print_table("R²", r2_by_gait(results))
        minutes = (time.monotonic() - started) / 60
        console.print(f"report written to {folder / 'report.html'} after {minutes:.1f} minutes")


def _study_gaits(
    config: ReproduceConfig, folder: Path, workers: WorkersConfig
) -> list[GaitResults]:
    seed = config.training.seed
    jobs = [Job(name, seed, folder / load_gait(name).name, name) for name in config.gaits]
    if len(jobs) == 1 and workers.backend == "loky":
        return [_study_job(config, jobs[0])]
    return run_sweep(jobs, partial(_study_job, config), workers)


def _study_job(config: ReproduceConfig, job: Job) -> GaitResults:
    """Trains the expert of a gait and studies it, from where the job stopped."""
    training = Job(job.gait, job.seed, job.folder / "training", job.title)
    say(f"{job.title}: training the expert")
    train_job(config.training, training)
    expert = training.folder / f"{load_gait(job.gait).name}.safetensors"
    return study_gait(job.gait, config, job.folder, resume=True, expert_file=expert)


def _deviations(config: ReproduceConfig, less: pd.DataFrame) -> tuple[str, ...]:
    """Lists what differs from the paper: by nature, and by the settings of this run."""
    here = [f"{row['setting']}: {row['here']}, not {row['in full']}." for _, row in less.iterrows()]
    engine = (WITHOUT_PYSR,) if config.engine == "operon" else ()
    return (*here, *engine, *DEVIATIONS)
