"""The kinds of students: their colours, settings and files in a run."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_student_of, policy_path
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Settings, checked
from glassgait.models.task.gait import Gait, gait_option
from glassgait.studies.common.experiment import OneGait
from glassgait.studies.common.policies import Policies
from glassgait.studies.common.run import CONFIG_NAME, read_run

ITSELF = "itself"
"""Value of the setting `collector` with which each student collects its samples itself."""


@dataclass(frozen=True)
class Student:
    """A kind of student, as tables and figures show it.

    Attributes:
        collector: The student that collects its samples; itself by default.
        brevity: Rank, 1 for the shortest, if the actions are sums of terms; otherwise None.
        paper_r2: The paper's R² (Table II), by gait; empty if the paper has no such student.
    """

    color: str
    marker: str
    collector: str | None = None
    brevity: int | None = None
    paper_r2: Mapping[str, float] = field(default_factory=dict)


STUDENTS: dict[str, Student] = {
    "linear": Student("#8A8A8A", "v", brevity=6),
    "linear_per_state": Student("#666666", "^", brevity=4),
    "gbm": Student(
        "#0072B2",
        "o",
        # The two visit similar states, and histograms are fitted five times as fast.
        collector="histogram_gbm",
        paper_r2={"walk": 0.9705, "trot": 0.9863, "pace": 0.9752, "bound": 0.9537},
    ),
    "histogram_gbm": Student("#2F8FC4", "h"),
    "ebm": Student(
        "#D55E00",
        "s",
        brevity=5,
        paper_r2={"walk": 0.9787, "trot": 0.9906, "pace": 0.9819, "bound": 0.9637},
    ),
    "symbolic": Student(
        "#009E73",
        "D",
        brevity=2,
        paper_r2={"walk": 0.6811, "trot": 0.7334, "pace": 0.7331, "bound": 0.6564},
    ),
    "symbolic_per_state": Student("#B8609A", "P", brevity=3),
    "formulas": Student("#A87400", "*", brevity=1),
}
"""The students by name, in the order of tables."""

if TYPE_CHECKING:
    StudentKind = str
else:
    StudentKind = Literal[tuple(STUDENTS)]


def paper_students() -> tuple[str, ...]:
    """Lists the students of the paper's tables and figures."""
    return tuple(name for name, student in STUDENTS.items() if student.paper_r2)


def sums_of_terms() -> tuple[str, ...]:
    """Lists the students whose actions are sums of terms, the shortest first."""
    ranked = [(student.brevity, name) for name, student in STUDENTS.items() if student.brevity]
    return tuple(name for _, name in sorted(ranked))


@checked
class StudentSettings(Settings):
    """Base class of a student's settings, and the settings of students that need none."""

    # Full-length episodes per round without the expert; None uses the distillation's setting.
    alone_episodes: ClassVar[int | None] = None

    def refuse_for(self, gait: Gait, symmetric: bool) -> None:
        """Raises an InputError if the gait cannot be fitted, before samples are collected."""

    def for_rounds(self) -> Self:
        """Returns the settings for collecting samples: smaller models, which are fitted faster."""
        return self

    def for_shuffled_split(self) -> Self:
        """Returns the settings of the fit that is scored on the paper's split."""
        return self

    def candidates(self) -> dict[str, tuple[Self, tuple[int, ...]]]:
        """Returns the candidate settings by title, each with its complexity."""
        return {}


def samples_folder(folder: Path, kind: str) -> Path:
    """Returns the folder of the samples that a student of a run is fitted to."""
    collector = STUDENTS[kind].collector or kind
    if (folder / CONFIG_NAME).exists():
        settings = read_run(folder, "distill")["settings"]
        collector = settings.get("collector") or collector
    return folder / (kind if collector == ITSELF else str(collector))


def load_students(folder: Path, expert: Policy) -> dict[str, Policy]:
    """Loads the students of a run, by kind."""
    kinds = [kind for kind in STUDENTS if policy_path(folder, kind).exists()]
    if not kinds:
        raise InputError(
            f"{folder}: holds no students; make them with "
            f"'glassgait distill {gait_option(expert.gait)}{expert.robot.option}'"
        )
    return {kind: load_student_of(expert, policy_path(folder, kind)) for kind in kinds}


@checked
class OnePolicy(OneGait):
    """Settings of a command that takes one student.

    Attributes:
        policy: Kind of student, or path of a policy file; by default `formulas`, otherwise the
            shortest student whose actions are sums of terms.
    """

    policy: str | None = None

    def find(self) -> tuple[Policies, str]:
        """Returns the policies of the gait, and the name of the selected one."""
        policies = self.policies()
        return policies, self.policy or default_student(policies)


def default_student(policies: Policies) -> str:
    """Returns the shortest available kind of student whose actions are sums of terms."""
    for kind in sums_of_terms():
        if kind in policies.files:
            return kind
    gait, option = policies.gait.name, policies.robot.option
    raise InputError(
        f"no student of the {gait} in {policies.place} acts by a sum of terms; make one with "
        f"'glassgait distill {gait_option(gait)}{option} --students {sums_of_terms()[1]}', "
        "or name another run with --source"
    )
