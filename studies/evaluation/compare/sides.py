"""The two policies that are compared: how they are named, found, told apart and let walk."""

from dataclasses import dataclass
from pathlib import Path

from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.palette import COLORS
from glassgait.studies.distillation.students.library import find_walker
from glassgait.studies.distillation.students.registry import policy_title

SIDE_COLORS = {"A": COLORS[0], "B": COLORS[-1]}
"""Blue and vermilion, which colour-blind readers tell apart too."""


@dataclass(frozen=True)
class Side:
    """One of the two policies.

    Attributes:
        letter: A or B.
        name: What a person named it by: `expert`, a kind of student, or the path of its file.
        policy: The policy.
        walker: The policy alone, with the estimator that it observes by.
    """

    letter: str
    name: str
    policy: Policy
    walker: AlternatingController

    @property
    def stem(self) -> str:
        """What folders call it."""
        return Path(self.name).stem

    @property
    def title(self) -> str:
        """What people call it; the letter tells apart two files of one name."""
        return f"{self.letter}: {policy_title(Path(self.name).name)}"

    @property
    def color(self) -> str:
        """Its colour, as hexadecimal red, green and blue."""
        return SIDE_COLORS[self.letter]


def find_side(letter: str, name: str, expert: NeuralPolicy, folder: Path | None) -> Side:
    """Finds one of the two policies.

    Args:
        letter: A or B.
        name: `expert`, a kind of student, or the path of a policy file.
        expert: The expert that a student must fit.
        folder: Folder of a distillation; as `find_walker` takes it.

    Raises:
        InputError: if there is no such policy, or it does not fit the expert.
    """
    walker = find_walker(name, expert, folder)
    return Side(letter, name, walker.policy, walker)
