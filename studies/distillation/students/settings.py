"""Students as settings: their names to choose from, and the settings of each.

A module of its own, read after the registry is filled: students of one's own have settings too.
"""

from dataclasses import dataclass, field, make_dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from glassgait.models.settings import Settings
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.student import StudentSettings


@dataclass(frozen=True)
class _EveryStudent(Settings):
    title: ClassVar[str] = "distillation"

    def of(self, name: str) -> StudentSettings:
        """Returns the settings of a student, by its name."""
        return getattr(self, name, STUDENTS[name].settings)


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
