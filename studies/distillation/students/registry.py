"""Every kind of student: an entry here is all that the studies need to know of one."""

from glassgait.studies.common.policies import rank
from glassgait.studies.distillation.students.baselines import (
    LINEAR,
    OPEN_LOOP,
    OSCILLATOR,
    STATEWISE_LINEAR,
)
from glassgait.studies.distillation.students.boosting import EBM, GBM, HISTOGRAM_GBM
from glassgait.studies.distillation.students.sparse_formula import SPARSE_FORMULA
from glassgait.studies.distillation.students.student import Student
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC

_KNOWN = (
    *(EBM, GBM, HISTOGRAM_GBM),
    *(LINEAR, OPEN_LOOP, OSCILLATOR, STATEWISE_LINEAR),
    *(SPARSE_FORMULA, STATEWISE_SYMBOLIC, SYMBOLIC),
)

STUDENTS: dict[str, Student] = {
    student.name: student for student in sorted(_KNOWN, key=lambda student: rank(student.name))
}
"""The students by name, in the order of tables."""

OTHER_COLOR, OTHER_MARKER = "#1b1f24", "X"
"""Of the expert, and of policies of a person's own."""


def student_title(name: str) -> str:
    """Returns what people call a student, or a policy of another name."""
    return STUDENTS[name].title if name in STUDENTS else name


def paper_students() -> tuple[str, ...]:
    """Lists the students of the paper's tables and figures."""
    return tuple(student.name for student in STUDENTS.values() if student.paper_r2)


def sums_of_terms() -> tuple[str, ...]:
    """Lists the students whose actions are sums of terms, those first that say most in fewest."""
    ranked = [(student.brevity, name) for name, student in STUDENTS.items() if student.brevity]
    return tuple(name for _, name in sorted(ranked))


def policy_title(name: str) -> str:
    """Returns what people call the expert, a student, or a policy of another name."""
    return "Neural expert" if name == "expert" else student_title(name)


def policy_color(name: str) -> str:
    """Returns the colour of the expert, a student, or a policy of another name, in all figures."""
    return STUDENTS[name].color if name in STUDENTS else OTHER_COLOR


def policy_marker(name: str) -> str:
    """Returns the marker that distinguishes a policy without colours too."""
    return STUDENTS[name].marker if name in STUDENTS else OTHER_MARKER
