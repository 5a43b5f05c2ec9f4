"""Every kind of student: an entry here is all that the studies need to know of one."""

from dataclasses import dataclass, field, fields, make_dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from glassgait.models.settings import Settings
from glassgait.studies.distillation.students.baselines import (
    LINEAR,
    OPEN_LOOP,
    OSCILLATOR,
    STATEWISE_LINEAR,
)
from glassgait.studies.distillation.students.boosting import EBM, GBM, HISTOGRAM_GBM
from glassgait.studies.distillation.students.sparse_formula import SPARSE_FORMULA
from glassgait.studies.distillation.students.student import Student, StudentSettings
from glassgait.studies.distillation.students.symbolic import STATEWISE_SYMBOLIC, SYMBOLIC

STUDENTS: dict[str, Student] = {
    student.name: student
    for student in (
        OPEN_LOOP,
        OSCILLATOR,
        LINEAR,
        STATEWISE_LINEAR,
        GBM,
        HISTOGRAM_GBM,
        EBM,
        SYMBOLIC,
        STATEWISE_SYMBOLIC,
        SPARSE_FORMULA,
    )
}
"""The students by name, in the order of tables."""


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


@dataclass(frozen=True)
class _EveryStudent(Settings):
    title: ClassVar[str] = "distillation"

    def of(self, name: str) -> StudentSettings:
        """Returns the settings of a student, by its name."""
        return getattr(self, name, STUDENTS[name].settings)

    def with_alone_episodes(self, count: int) -> Self:
        """Returns the settings with as many episodes alone for every student that has its own."""
        own = {
            each.name: replace(self.of(each.name), alone_episodes=count)
            for each in fields(self)
            if self.of(each.name).alone_episodes is not None
        }
        return replace(self, **own)


if TYPE_CHECKING:
    StudentKind = str

    class StudentsSettings(_EveryStudent):
        """Settings of every student that has any, by its name."""

        def __init__(self, **settings: StudentSettings) -> None: ...
else:
    # The registry alone says which students there are.
    StudentKind = Literal[tuple(STUDENTS)]
    StudentsSettings = make_dataclass(
        "StudentsSettings",
        [
            (name, type(student.settings), field(default=student.settings))
            for name, student in STUDENTS.items()
            if type(student.settings) is not StudentSettings
        ],
        bases=(_EveryStudent,),
        namespace={"__doc__": "Settings of every student that has any, by its name."},
        frozen=True,
    )
    StudentsSettings.__module__ = __name__
