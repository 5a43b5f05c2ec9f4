"""`glassgait distill` and `glassgait refine`: fit students, and fine-tune formulas."""

from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import tyro

from glassgait.models.policies.library import policy_path
from glassgait.models.settings import checked
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.jobs import (
    Gaits,
    Job,
    Seeds,
    Workers,
    expand_gaits,
    jobs_of,
    run_jobs,
)
from glassgait.studies.common.policies import EXPERT, find_expert
from glassgait.studies.common.run import CHECKPOINT_NAME, default_folder, open_run
from glassgait.studies.common.settings_file import SettingsFile
from glassgait.studies.distillation.config import DistillationConfig, RefinementConfig
from glassgait.studies.distillation.students import OnePolicy

if TYPE_CHECKING:
    import pandas as pd


@checked
class Distill(SettingsFile):
    """Distil an expert into glass-box students by DAgger with alternation.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships.
        n_seeds: Number of seeds of each gait: seed, seed + 1, …
        workers: Workers that run the jobs or, with one gait and seed, fit its students.
        robot: Name of a robot, or path of its robot.yaml; by default the expert's.
        source: Folder of a run of train that contains the expert; by default, the expert that
            ships is used or, for other gaits, the one in runs/train/<gait>.
        expert: Description of a network of another project, in place of --source.
        output: Folder of the run; runs/distill/<gait> by default. Each of several gaits has a
            subfolder <gait>, and each of several seeds a subfolder seed_<seed> in it.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "distill"

    gait: Gaits = ("trot",)
    config: Annotated[DistillationConfig, tyro.conf.arg(name="")] = field(
        default_factory=DistillationConfig
    )
    n_seeds: Seeds = 1
    workers: Annotated[Workers, tyro.conf.arg(name="")] = field(default_factory=Workers)
    robot: str | None = None
    source: Path | None = None
    expert: Path | None = None
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        from glassgait.studies.common.tables import print_table

        # Refuse invalid settings before any job begins.
        gaits = [load_gait(name) for name in expand_gaits(self.gait)]
        source = self.expert or self.source
        experts = [find_expert(gait, source, self.robot) for gait in gaits]
        for gait, expert in zip(gaits, experts, strict=True):
            self.config.for_gait(gait, symmetric=expert.symmetric)
        root = default_folder(self.title, experts[0].robot.name)
        seeds = range(self.config.seed, self.config.seed + self.n_seeds)
        jobs = jobs_of(self.gait, seeds, root, self.output)
        run = partial(_distill_job, self.config, source, self.robot, resume=self.resume)
        with self.workers.pool():
            tables = run_jobs(jobs, run)
        if len(jobs) == 1:
            from glassgait.studies.training.closing import show_result

            (job,) = jobs
            print_table("R² on held-out data", tables[0])
            show_result(job.gait, job.folder, experts[0].robot.source)
            console.print(f"students written to {job.folder}")


def _distill_job(
    config: DistillationConfig, source: Path | None, robot: str | None, job: Job, *, resume: bool
) -> "pd.DataFrame":
    """Distils one expert, and returns its R² table."""
    from glassgait.studies.distillation.study import distill, write_r2_table

    gait = load_gait(job.gait)
    config = replace(config, gait=job.gait, seed=job.seed)
    expert = find_expert(gait, source, robot)
    r2 = distill(config, gait, expert, job.folder, resume=resume)
    return write_r2_table(r2, gait.name, job.folder)


@checked
class Refine(OnePolicy, SettingsFile):
    """Fine-tune the numbers in a policy of formulas in closed loop, by PPO.

    Attributes:
        output: Folder of the run; runs/refine/<gait>/<policy> by default.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "refine"

    config: Annotated[RefinementConfig, tyro.conf.arg(name="")] = field(
        default_factory=RefinementConfig
    )
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        from glassgait.studies.distillation.refinement import RefinementRun

        policies, named = self.find()
        # Without an expert, `policies.expert` raises an error.
        policy, expert = policies.formulas(named), policies.expert_of(named) or policies.expert
        gait, name = policies.gait, Path(named).stem
        folder = self.output or policies.output(self.title) / name
        with open_run(
            folder,
            study=self.title,
            settings=self.config,
            inputs={"gait": gait.digest(), "policy": policy.digest(), "expert": expert.digest()},
            resume=self.resume,
            free=("updates",),
        ):
            begun = (folder / CHECKPOINT_NAME).exists()
            run = RefinementRun(self.config, gait, expert, policy, folder, name=name, resume=begun)
            # The formulas need the expert's state estimator, even if the folder is moved.
            expert.save(policy_path(folder, EXPERT))
            run.run()
        console.print(f"formulas written to {folder / name}{policy.suffix}")
