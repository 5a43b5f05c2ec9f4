"""Who acts in a rollout, as a person names it."""

from fractions import Fraction
from pathlib import Path

from models.errors import InputError
from models.policies.library import load_policy
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


def find_student(name: str, folder: Path, expert: NeuralPolicy) -> Policy:
    """Loads a student by its kind, from a distillation's folder, or by its file.

    Raises:
        InputError: if there is no such student, or it does not fit the expert.
    """
    path = student_path(folder, name) if name in STUDENT_TITLES else Path(name)
    if path.suffix != ".safetensors":
        raise InputError(
            f"unknown policy {name!r}; the policies are expert, {', '.join(STUDENT_TITLES)}, "
            "or the path of a policy file ending in .safetensors"
        )
    if not path.exists():
        raise InputError(
            f"{path}: no such student; make it with 'glassgait distill --gait {expert.gait}'"
        )
    student = load_policy(path)
    student.check(gait=expert.gait, observation_names=expert.observation_names)
    return student
