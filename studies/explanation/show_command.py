"""`glassgait explain terms`: prints the file of formulas that is a policy."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from rich.text import Text

from glassgait.models.certificates.findings import OUTCOME_WORDS
from glassgait.models.robots import quadruped
from glassgait.models.settings import Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.experts import find_expert
from glassgait.studies.distillation.students.certificates import find_certificate
from glassgait.studies.distillation.students.library import (
    default_student,
    find_formulas,
    student_file,
)
from glassgait.studies.distillation.students.registry import student_title


@dataclass(frozen=True)
class Show(Settings):
    """Print the formulas of a policy: the lines that its file holds, and that act.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: Kind of student, or path of a formula file; of the shipped formulas the shortest by
            default.
        joint: Joint whose lines alone are printed, such as FL_calf; all by default.
        distillation: Folder of a distillation; runs/distillation/<gait> by default, and where that
            lacks the student, the shipped one.
        expert: Policy file of the expert; by default the shipped one, or what was trained here.
    """

    title: ClassVar[str] = "show"

    gait: Annotated[str, tyro.conf.Positional] = "trot"
    policy: str | None = None
    joint: str | None = None
    distillation: Path | None = None
    expert: Path | None = None

    def run(self) -> None:
        """Prints the formulas."""
        gait = load_gait(self.gait)
        name = self.policy or default_student(gait.name, self.distillation)
        expert = find_expert(gait, self.expert)
        student = find_formulas(name, expert, self.distillation)
        if self.joint is not None:
            quadruped.joint_index(self.joint)
        lines = student.to_text().splitlines()
        for line in lines_of_joint(lines, self.joint) if self.joint else lines:
            console.print(_colored(line), soft_wrap=True)
        written = len(student.to_file().written())
        # A comment, so that what is printed is a file that can be taken and changed.
        console.print(
            f"\n# {student_title(name)}: {student.n_terms()} terms in {written} formulas, on "
            f"{len(lines)} lines",
            style="dim",
        )
        certificate = find_certificate(student_file(name, gait.name, self.distillation), gait)
        if certificate:
            counts = certificate.counts().items()
            told = ", ".join(f"{count} {OUTCOME_WORDS[outcome]}" for outcome, count in counts)
            console.print(
                f"# Claims about it: {told}; 'glassgait explain page' tells them", style="dim"
            )


def lines_of_joint(lines: list[str], joint: str) -> list[str]:
    """Leaves, of a file's lines, the titles and those of one joint.

    Args:
        lines: Lines of a formula file.
        joint: Name of the joint.
    """
    kept, mine = [], False
    for line in lines:
        if not line.startswith(" "):
            mine = line.startswith(f"{joint} ")
        if mine or line.startswith(("state ", "every state")):
            kept.append(line)
    return kept


def _colored(line: str) -> Text:
    """Sets apart comments, titles and the names of joints."""
    code, sign, comment = line.partition("#")
    text = Text(code)
    if code.startswith(("state ", "every state", "definitions")):
        text.stylize("bold")
    elif not code.startswith(" ") and " = " in code:
        text.stylize("bold cyan", 0, code.index(" = "))
    return text.append(sign + comment, style="dim")
