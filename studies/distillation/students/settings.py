"""Students as settings: their names to choose from, and the settings of each.

A module of its own, read after the registry is filled: students of one's own have settings too.
"""

from typing import TYPE_CHECKING, ClassVar, Literal

from glassgait.models.settings import Settings, checked
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.student import StudentSettings


@checked
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
    _SETTINGS = {
        name: student.settings
        for name, student in STUDENTS.items()
        if type(student.settings) is not StudentSettings
    }
    StudentsSettings = checked(
        type(
            "StudentsSettings",
            (_EveryStudent,),
            {
                "__doc__": "Settings of every student that has any, by its name.",
                "__module__": __name__,
                "__annotations__": {name: type(own) for name, own in _SETTINGS.items()},
                **_SETTINGS,
            },
        )
    )
