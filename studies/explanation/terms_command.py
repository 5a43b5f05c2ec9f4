"""`glassgait explain terms`: prints the file of formulas that is a policy."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from rich.text import Text

from glassgait.models.certificates.reading import OUTCOME_WORDS
from glassgait.models.robots import quadruped
from glassgait.models.settings import Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import find_policies
from glassgait.studies.distillation.students.library import default_student, find_certificate
from glassgait.studies.distillation.students.registry import student_title


@dataclass(frozen=True)
class ExplainTerms(Settings):
    """Print the formulas of a policy: the lines that its file holds, and that act.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: Kind of student, or path of a formula file; of the shipped formulas the shortest by
            default.
        joint: Joint whose lines alone are printed, such as FL_calf; all by default.
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from, in place of those
            that ship.
    """

    title: ClassVar[str] = "show"

    gait: str = "trot"
    policy: str | None = None
    joint: str | None = None
    robot: str | None = None
    source: Path | None = None

    def run(self) -> None:
        """Prints the formulas."""
        found = find_policies(load_gait(self.gait), self.source, self.robot)
        name = self.policy or default_student(found)
        student = found.formulas(name)
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
        certificate = find_certificate(found.file(name), found.gait, robot=student.robot)
        if certificate:
            counts = certificate.counts().items()
            found = ", ".join(f"{count} {OUTCOME_WORDS[outcome]}" for outcome, count in counts)
            console.print(
                f"# Claims about it: {found}; 'glassgait explain page' shows them", style="dim"
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
