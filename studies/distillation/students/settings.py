"""Students as settings: their names to choose from, and the settings of each.

A module of its own, read after the registry is filled: students of one's own have settings too.
"""

from dataclasses import dataclass, field, fields, make_dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from glassgait.models.settings import Settings
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.student import StudentSettings


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
