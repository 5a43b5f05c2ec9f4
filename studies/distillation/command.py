"""`glassgait distill`: distils an expert into students."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro

from glassgait.models.policies.library import load_expert
from glassgait.models.settings import Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.console import console, say
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.study import distill
from glassgait.studies.distillation.tables import write_r2_table
from glassgait.studies.students.library import distillation_folder
from glassgait.studies.tables import print_table


@dataclass(frozen=True)
class Distill(Settings):
    """Distil an expert into glass-box students by DAgger with alternation.

    Attributes:
        config: Settings of the run.
        expert: Policy file of the expert; the shipped one by default.
        output: Folder of the run; runs/distillation/<gait> by default.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "distill"

    config: Annotated[DistillationConfig, tyro.conf.arg(name="")] = field(
        default_factory=DistillationConfig
    )
    expert: Path | None = None
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        """Runs the study."""
        gait = load_gait(self.config.gait)
        expert = load_expert(gait, self.expert)
        folder = self.output or distillation_folder(gait.name)
        r2 = distill(self.config, gait, expert, folder, say, resume=self.resume)
        table = write_r2_table(r2, gait.name, folder)
        print_table("R² on held-out data", table)
        console.print(f"students written to {folder}")
