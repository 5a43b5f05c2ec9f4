"""Expert and student acting by turns (paper, Algorithm 1)."""

from dataclasses import dataclass
from typing import Any

from glassgait.models.a1.robot import Array
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.alternation import expert_acts


@dataclass(frozen=True)
class AlternatingPolicy:
    """An expert alone, a student alone, or both by turns.

    Attributes:
        expert: The expert; its estimator observes for both.
        student: The student, or None.
        period: Control steps from one action of the expert to the next; 1 is the expert alone, 0
            the student alone.
    """

    expert: NeuralPolicy
    student: Policy | None = None
    period: int = 1

    def act(self, step: int, observation: Array) -> Array:
        """Returns the actions (n, 12) at a control step."""
        if self.student is None or expert_acts(step, self.period):
            return self.expert(observation)
        return self.student(observation)

    def settings(self) -> dict[str, Any]:
        """Returns all that changes the actions but the policies, as values that JSON can hold."""
        return {"period": self.period}

    @property
    def acting_expert(self) -> NeuralPolicy | None:
        """The expert, unless it never acts."""
        return None if self.period == 0 else self.expert

    @property
    def acting_student(self) -> Policy | None:
        """The student, unless it never acts."""
        return None if self.period == 1 else self.student
