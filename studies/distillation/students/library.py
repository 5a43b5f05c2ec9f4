"""Finds the students of runs."""

from pathlib import Path

from glassgait.models.errors import InputError
from glassgait.models.policies.library import (
    load_student_of,
    policy_path,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import checked
from glassgait.studies.common.policies import OneGait, Policies
from glassgait.studies.common.run_folder import CONFIG_NAME, read_settings
from glassgait.studies.distillation.students.registry import STUDENTS, sums_of_terms
from glassgait.studies.distillation.students.student import ITSELF


def samples_folder(folder: Path, kind: str) -> Path:
    """Returns where a run keeps the samples that a student of a kind is fitted to.

    Raises:
        InputError: if the folder holds a run of something else, or its settings are damaged.
    """
    collector = STUDENTS[kind].collector or kind
    if (folder / CONFIG_NAME).exists():
        collector = read_settings(folder, "distill").get("collector") or collector
    return folder / (kind if collector == ITSELF else str(collector))


def load_students(folder: Path, expert: NeuralPolicy) -> dict[str, Policy]:
    """Loads the students of a run, by kind.

    Raises:
        InputError: if the folder holds none, or a student does not fit the expert.
    """
    kinds = [kind for kind in STUDENTS if policy_path(folder, kind).exists()]
    if not kinds:
        raise InputError(
            f"{folder}: holds no students; make them with "
            f"'glassgait distill --gait {expert.gait}{expert.robot.option}'"
        )
    return {kind: load_student_of(expert, policy_path(folder, kind)) for kind in kinds}


@checked
class OnePolicy(OneGait):
    """Settings of a command that takes one student.

    Attributes:
        policy: Kind of student, or path of a policy file; by default the student whose actions are
            sums of the fewest terms.
    """

    policy: str | None = None

    def find(self) -> tuple[Policies, str]:
        """Finds the policies of the gait, and returns the name of the one that is taken."""
        found = self.policies()
        return found, self.policy or default_student(found)


def default_student(found: Policies) -> str:
    """Names the student of a gait that is explained where a person names none.

    Raises:
        InputError: if there is no student whose actions are sums of terms.
    """
    for kind in sums_of_terms():
        if kind in found.files:
            return kind
    gait = found.gait.name
    raise InputError(
        f"no student of the {gait} in {found.place} acts by a sum of terms; make one with "
        f"'glassgait distill --gait {gait}{found.robot.option} --students {sums_of_terms()[1]}', "
        "or name another run with --source"
    )
