"""`glassgait gait`: checks a gait file and draws its reward machine."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from glassgait.models.files import write_atomically
from glassgait.models.policies.library import find_gait
from glassgait.models.task.drawing import to_mermaid
from glassgait.studies.common.console import console


@dataclass(frozen=True)
class ShowGait:
    """Check a gait file and draw its reward machine.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        output: Markdown file for the drawing; the terminal by default.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    output: Path | None = None

    def run(self) -> None:
        """Checks and draws."""
        gait = find_gait(self.gait)
        drawing = f"```mermaid\n{to_mermaid(gait)}```\n"
        if self.output is None:
            console.print(drawing, soft_wrap=True)
            return
        write_atomically(self.output, drawing)
        console.print(f"{gait.name}: {gait.n_states} states, drawn in {self.output}")
