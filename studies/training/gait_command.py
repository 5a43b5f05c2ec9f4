"""`glassgait gait`: checks a gait file, or a robot's day, and draws its state machine."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically
from glassgait.models.policies.library import find_gait
from glassgait.models.task.day import Day, load_day
from glassgait.models.task.drawing import to_graphviz, to_mermaid
from glassgait.studies.common.console import console

EXTENSIONS = {".mmd": "mermaid", ".md": "mermaid", ".dot": "graphviz", ".gv": "graphviz"}
"""Languages by the extension of a drawing's file."""


@dataclass(frozen=True)
class ShowGait:
    """Check a gait file, or a robot's day, and draw its state machine.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        day: In place of a gait, `day`, which ships, or path of a day's file.
        format: Language of the drawing; by default that of the output's extension, or mermaid.
        output: File for the drawing, .mmd or .md (mermaid), .dot or .gv (graphviz); the terminal
            by default.
    """

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    day: str | None = None
    format: Literal["mermaid", "graphviz"] | None = None
    output: Path | None = None

    def run(self) -> None:
        """Checks and draws."""
        language = self._language()
        machine = find_gait(self.gait) if self.day is None else load_day(self.day)
        drawing = to_graphviz(machine) if language == "graphviz" else to_mermaid(machine)
        if self.output is None:
            console.print(drawing, soft_wrap=True)
            return
        if self.output.suffix.lower() == ".md":
            drawing = f"```mermaid\n{drawing}```\n"
        write_atomically(self.output, drawing)
        if isinstance(machine, Day):
            name, counted = self.day, f"{len(machine.modes)} modes"
        else:
            name, counted = machine.name, f"{machine.n_states} states"
        console.print(f"{name}: {counted}, drawn in {self.output}")

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
