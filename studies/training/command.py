"""`glassgait train`: trains an expert."""

from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.files import digest
from glassgait.models.robots.library import load_robot
from glassgait.models.settings import checked
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.jobs import Gaits, Job, Seeds, Workers, jobs_of, run_jobs
from glassgait.studies.common.run import CHECKPOINT_NAME, default_folder, open_run
from glassgait.studies.common.settings_file import SettingsFile
from glassgait.studies.training.config import TrainingConfig


@checked
class Train(SettingsFile):
    """Train a neural expert by PPO.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every built-in gait.
        n_seeds: Number of seeds per gait: seed, seed + 1, …
        workers: Workers that run the jobs; a single job runs in this process.
        output: Folder of the run; runs/train/<gait> by default. Each of several gaits has a
            subfolder <gait>, and each of several seeds a subfolder seed_<seed> in it.
        resume: Continue the run in the folder.
    """

    title: ClassVar[str] = "train"

    gait: Gaits = ("trot",)
    config: Annotated[TrainingConfig, tyro.conf.arg(name="")] = field(
        default_factory=TrainingConfig
    )
    n_seeds: Seeds = 1
    workers: Annotated[Workers, tyro.conf.arg(name="")] = field(default_factory=Workers)
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        config = self.config
        root = default_folder(self.title, load_robot(config.robot).name)
        seeds = range(config.seed, config.seed + self.n_seeds)
        jobs = jobs_of(self.gait, seeds, root, self.output)
        with self.workers.pool():
            run_jobs(jobs, partial(train_job, config, resume=self.resume))
        if len(jobs) == 1:
            from glassgait.studies.training.closing import show_result

            (job,) = jobs
            show_result(job.gait, job.folder, config.robot)
            path = job.folder / f"{load_gait(job.gait).name}.safetensors"
            console.print(f"expert written to {path}")


def train_job(config: TrainingConfig, job: Job, *, resume: bool) -> None:
    """Trains one expert, starting from a checkpoint if one exists."""
    from glassgait.studies.training.run import TrainingRun

    config = replace(config, gait=job.gait, seed=job.seed)
    gait = load_gait(config.gait)
    inputs = {"gait": gait.digest()}
    if config.warm_start is not None:
        inputs["warm_start"] = digest(Path(config.warm_start))

    # A resumed run may have more updates; all other settings must be the same.
    with open_run(
        job.folder, study="train", settings=config, inputs=inputs, resume=resume, free=("updates",)
    ):
        has_checkpoint = (job.folder / CHECKPOINT_NAME).exists()
        TrainingRun(config, gait, job.folder, resume=has_checkpoint).run()
