"""`glassgait gait`: checks a gait file and draws its reward machine."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.library import find_gait
from glassgait.models.task.drawing import to_graphviz, to_mermaid
from glassgait.studies.common.console import console

EXTENSIONS = {".mmd": "mermaid", ".md": "mermaid", ".dot": "graphviz", ".gv": "graphviz"}
"""Languages by the extension of a drawing's file."""


@dataclass(frozen=True)
class ShowGait:
    """Check a gait file and draw its reward machine.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        format: Language of a drawing in the terminal.
        output: File for the drawing, .mmd or .md (mermaid), .dot or .gv (graphviz); the terminal
            by default.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    format: Literal["mermaid", "graphviz"] = "mermaid"
    output: Path | None = None

    def run(self) -> None:
        """Checks and draws."""
        gait = find_gait(self.gait)
        language, path = self.format, self.output
        if path is not None:
            language = EXTENSIONS.get(path.suffix.lower())
        if language is None:
            raise InputError(
                f"--output {path}: is none of {', '.join(EXTENSIONS)}; for a picture write a .dot "
                "file and run 'dot -Tsvg' on it"
            )
        drawing = to_graphviz(gait) if language == "graphviz" else to_mermaid(gait)
        if path is None:
            console.print(drawing, soft_wrap=True)
            return
        if path.suffix.lower() == ".md":
            drawing = f"```mermaid\n{drawing}```\n"
        write_atomically(path, drawing)
        console.print(f"{gait.name}: {gait.n_states} states, drawn in {path}")
