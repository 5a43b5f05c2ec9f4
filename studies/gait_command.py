"""`glassgait gait`: checks a gait file and draws its reward machine."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from models.files import write_atomically
from models.task.drawing import to_graphviz, to_mermaid
from models.task.gait import load_gait
from studies.console import console


@dataclass(frozen=True)
class ShowGait:
    """Check a gait file and draw its reward machine.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        format: Language of the drawing.
        output: File for the drawing; the terminal by default.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    format: Literal["mermaid", "graphviz"] = "mermaid"
    output: Path | None = None

    def run(self) -> None:
        """Checks and draws."""
        gait = load_gait(self.gait)
        drawing = to_mermaid(gait) if self.format == "mermaid" else to_graphviz(gait)
        if self.output is None:
            console.print(drawing, soft_wrap=True)
        else:
            write_atomically(self.output, drawing)
            console.print(f"{gait.name}: {gait.n_states} states, drawn in {self.output}")
