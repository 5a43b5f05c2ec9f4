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
        format: Language of the drawing; by default that of the output's extension, or mermaid.
        output: File for the drawing, .mmd or .md (mermaid), .dot or .gv (graphviz); the terminal
            by default.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    format: Literal["mermaid", "graphviz"] | None = None
    output: Path | None = None

    def run(self) -> None:
        """Checks and draws."""
        language = self._language()
        gait = find_gait(self.gait)
        drawing = to_graphviz(gait) if language == "graphviz" else to_mermaid(gait)
        if self.output is None:
            console.print(drawing, soft_wrap=True)
            return
        if self.output.suffix.lower() == ".md":
            drawing = f"```mermaid\n{drawing}```\n"
        write_atomically(self.output, drawing)
        console.print(f"{gait.name}: {gait.n_states} states, drawn in {self.output}")

    def _language(self) -> str:
        if self.output is None:
            return self.format or "mermaid"
        language = EXTENSIONS.get(self.output.suffix.lower())
        if language is None:
            raise InputError(
                f"--output {self.output}: is none of {', '.join(EXTENSIONS)}; for a picture write "
                "a .dot file and run 'dot -Tsvg' on it"
            )
        if self.format not in (None, language):
            raise InputError(
                f"--output {self.output}: its extension is that of {language}, not {self.format}; "
                "leave --format out"
            )
        return language
