"""`glassgait simplify`: lets an expert learn on, so that few terms can copy it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.policies.library import find_gait
from glassgait.models.settings import Settings
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import find_expert
from glassgait.studies.common.run_folder import CHECKPOINT_NAME, default_folder, open_run
from glassgait.studies.distillation.simplification.study import (
    SimplificationConfig,
    SimplificationRun,
)
from glassgait.studies.training.command import show_learning


@dataclass(frozen=True)
class Simplify(Settings):
    """Let an expert learn on while it is pulled to a page of formulas, fitted anew as it changes.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        config: Settings of the run.
        robot: Name of a robot, or path of its robot.yaml; by default that of the expert.
        source: Folder of a run of train or simplify, whose expert is taken; by default the one
            that ships, or what was trained here.
        output: Folder of the run; runs/simplify/<gait> by default.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "simplify"

    gait: str = "trot"
    config: Annotated[SimplificationConfig, tyro.conf.arg(name="")] = field(
        default_factory=SimplificationConfig
    )
    robot: str | None = None
    source: Path | None = None
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        """Runs the study."""
        gait = find_gait(self.gait, self.robot)
        expert = find_expert(gait, self.source, self.robot)
        folder = self.output or default_folder(self.title, expert.robot.name) / gait.name
        with open_run(
            folder,
            study=self.title,
            settings=self.config,
            inputs={"gait": gait.digest(), "starting expert": expert.digest()},
            resume=self.resume,
            free=("updates",),
        ):
            begun = (folder / CHECKPOINT_NAME).exists()
            run = SimplificationRun(self.config, gait, expert, folder, resume=begun)
            show_learning(run)
        differ = run.progress.curve[-1]["page_error"]
        console.print(f"expert and page, {differ:.3f} rad apart (rms), written to {folder}")
