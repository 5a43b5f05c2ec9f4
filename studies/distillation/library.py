"""Where students are kept, and finding them."""

from pathlib import Path

from models.errors import InputError
from models.policies.library import load_policy, load_student, shipped_students
from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from studies.distillation.config import STUDENT_TITLES, StudentKind


def distillation_folder(gait: str) -> Path:
    """Returns where a gait's distillation is kept, unless a person names another folder."""
    return Path("runs/distillation") / gait


def student_path(folder: Path, kind: str) -> Path:
    """Returns where a run keeps the student of a kind."""
    return folder / f"{kind}.safetensors"


def collector(kind: StudentKind) -> StudentKind:
    """Returns the kind of student that collects a student's samples: mostly itself.

    The two gradient boostings differ little in where they go, and histograms are fitted five times
    as fast.
    """
    return "histogram_gbm" if kind == "gbm" else kind


def samples_folder(folder: Path, kind: StudentKind) -> Path:
    """Returns where a run keeps the samples that a student of a kind is fitted to."""
    return folder / collector(kind)


def load_students(folder: Path, expert: NeuralPolicy) -> dict[StudentKind, Policy]:
    """Loads the students of a run, by kind.

    Raises:
        InputError: if the folder holds none, or a student does not fit the expert.
    """
    students = {}
    for kind in STUDENT_TITLES:
        path = student_path(folder, kind)
        if path.exists():
            students[kind] = load_policy(path)
            students[kind].check(gait=expert.gait, observation_names=expert.observation_names)
    if not students:
        raise InputError(
            f"{folder}: holds no students; make them with 'glassgait distill --gait {expert.gait}'"
        )
    return students


def find_student(name: str, expert: NeuralPolicy, folder: Path | None = None) -> Policy:
    """Loads a student by its kind or by its file.

    Args:
        name: Kind of student, or path of a policy file.
        expert: The expert that it must fit.
        folder: Folder of a distillation; by default runs/distillation/<gait>, and where that lacks
            the student, the shipped one.

    Raises:
        InputError: if there is no such student, or it does not fit the expert.
    """
    student = _load_student(name, expert.gait, folder)
    student.check(gait=expert.gait, observation_names=expert.observation_names)
    return student


def _load_student(name: str, gait: str, folder: Path | None) -> Policy:
    if name not in STUDENT_TITLES:
        if Path(name).suffix != ".safetensors":
            raise InputError(
                f"unknown policy {name!r}; the policies are expert, {', '.join(STUDENT_TITLES)}, "
                "or the path of a policy file ending in .safetensors"
            )
        return load_policy(Path(name))
    path = student_path(folder or distillation_folder(gait), name)
    if folder is None and not path.exists() and name in shipped_students(gait):
        return load_student(gait, name)
    if not path.exists():
        raise InputError(f"{path}: no such student; make it with 'glassgait distill --gait {gait}'")
    return load_policy(path)
