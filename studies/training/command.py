"""`glassgait train`: trains an expert."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.errors import InputError
from glassgait.models.settings import Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.console import console, progress_bar
from glassgait.studies.run_folder import open_run
from glassgait.studies.training.checkpoint import CHECKPOINT_NAME
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.record import read_config
from glassgait.studies.training.study import TrainingRun

LINES_EVERY = 10


@dataclass(frozen=True)
class Train(Settings):
    """Train a neural expert by PPO.

    Attributes:
        config: Settings of the run.
        like: Record of an expert (<gait>.yaml) whose settings are taken instead.
        output: Folder of the run; runs/training/<gait> by default.
        resume: Continue from the folder's checkpoint.
    """

    title: ClassVar[str] = "train"

    config: Annotated[TrainingConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainingConfig
    )
    like: Path | None = None
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        """Runs the study."""
        config = self._config()
        gait = load_gait(config.gait)
        folder = self.output or Path("runs/training") / gait.name
        with open_run(
            folder,
            study="train",
            settings=config,
            inputs={"gait": gait.digest()},
            resume=self.resume,
            free=("updates",),
        ):
            begun = (folder / CHECKPOINT_NAME).exists()
            _train(TrainingRun(config, gait, folder, resume=begun))
        console.print(f"expert written to {folder / gait.name}.safetensors")

    def _config(self) -> TrainingConfig:
        if self.like is None:
            return self.config
        if self.config != TrainingConfig():
            raise InputError(
                "--like takes every setting from the record; leave the other settings out"
            )
        return read_config(self.like)


def _train(run: TrainingRun) -> None:
    updates = run.config.updates
    if run.progress.update > updates:
        raise InputError(
            f"{run.folder}: has {run.progress.update} updates already; ask for more with --updates"
        )
    with progress_bar(updates, run.progress.update) as (progress, task):

        def report(run: TrainingRun, row: dict[str, float]) -> None:
            line = (
                f"{run.control_steps / run.progress.seconds:5.0f} steps/s  "
                f"reward {row['reward']:.3f}  rhythm {row['rhythm']:.2f}  "
                f"difficulty {row['difficulty']:.2f}  failures {row['failure_rate']:.4f}"
            )
            progress.update(task, completed=run.progress.update, text=line)
            if not console.is_terminal and run.progress.update % LINES_EVERY == 0:
                console.print(f"update {run.progress.update}/{updates}  {line}")

        run.run(report)
