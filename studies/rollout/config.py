"""Who acts in a rollout, as a person names it."""

from fractions import Fraction
from pathlib import Path

from models.errors import InputError
from models.policies.library import load_policy, load_student, shipped_students
from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from studies.distillation.config import STUDENT_TITLES
from studies.distillation.study import student_path


def parse_ratio(text: str) -> int:
    """Turns an alternation ratio such as 1, 1/4 or 0 into the expert's period.

    Raises:
        InputError: if the text is not such a ratio.
    """
    try:
        ratio = Fraction(text)
    except (ValueError, ZeroDivisionError):
        ratio = Fraction(-1)
    if ratio == 0:
        return 0
    if ratio.numerator != 1:
        raise InputError(f"ratio {text!r} is not an alternation ratio; give 1, 0, or 1/2, 1/3, …")
    return ratio.denominator


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
    path = student_path(folder or Path("runs/distillation") / gait, name)
    if folder is None and not path.exists() and name in shipped_students(gait):
        return load_student(gait, name)
    if not path.exists():
        raise InputError(f"{path}: no such student; make it with 'glassgait distill --gait {gait}'")
    return load_policy(path)
