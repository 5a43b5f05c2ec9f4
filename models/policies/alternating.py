"""Expert and student acting by turns (paper, Algorithm 1)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.policies.policy import Policy, refuse_other_estimator
from glassgait.models.robots.robot import Robot
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.assurance import Guard, initial_guard


class Turn(NamedTuple):
    """One control step of n robots, along the first axis.

    Attributes:
        action: Actions (n, 12).
        expert_acts: Whether they are the expert's (n,).
        guard: What the next step is told of this one.
    """

    action: Array
    expert_acts: NDArray[np.bool_]
    guard: Guard


@dataclass(frozen=True)
class AlternatingPolicy:
    """An expert alone, a student alone, or both by turns.

    Attributes:
        expert: The expert; its estimator, if it has one, observes for both.
        student: The student, or None.
        period: Control steps from one action of the expert to the next; 1 is the expert alone, 0
            the student alone.
    """

    expert: Policy
    student: Policy | None = None
    period: int = 1

    def __post_init__(self) -> None:
        """
        Raises:
            ValueError: if the period is negative, or asks for a student that is not given.
            InputError: if the student observes by the estimator of another expert.
        """
        if self.student is not None:
            refuse_other_estimator(self.expert, self.student)
        if self.period < 0:
            raise ValueError(f"alternation: period is {self.period}; it must be 0 or more")
        if self.student is None and self.period != 1:
            raise ValueError(f"alternation: period {self.period} needs a student; give one")

    def expert_acts(self, step: int) -> bool:
        """Tells whether the expert acts at a control step, counted from the episode's start."""
        return bool(expert_acts(step, self.period))

    def act(self, step: int, observation: Array) -> Array:
        """Returns the actions (n, 12) at a control step."""
        if self.student is None or self.expert_acts(step):
            return self.expert(observation)
        return self.student(observation)

    def begin(self, n_robots: int) -> Guard:
        """Returns what the first step is told; a schedule goes by time alone, and ignores it."""
        return initial_guard((n_robots,))

    def advance(self, step: int, observation: Array, guard: Guard) -> Turn:
        """Acts at a control step (n robots), and tells who did."""
        acts = np.full(len(observation), self.student is None or self.expert_acts(step))
        return Turn(self.act(step, observation), acts, guard)

    @property
    def robot(self) -> Robot:
        """The robot that it is made for."""
        return self.expert.robot

    @property
    def estimator(self) -> Callable[[Array], Array] | None:
        """Maps proprioception to the body state; None where the expert observes the true one."""
        return self.expert.estimator

    @property
    def limits_targets(self) -> bool:
        """Whether joints follow targets within their ranges alone.

        They do if the expert learned so, and if a student acts alone that is to be run so.
        """
        student = self.student if self.period == 0 else None
        return self.expert.limits_targets or (student is not None and student.limits_targets)

    def settings(self) -> dict[str, Any]:
        """Returns all that changes the actions but the policies, as values that JSON can hold."""
        return {"period": self.period}

    @property
    def acting_expert(self) -> Policy | None:
        """The expert, unless it never acts."""
        return None if self.period == 0 else self.expert

    @property
    def acting_student(self) -> Policy | None:
        """The student, unless it never acts."""
        return None if self.period == 1 else self.student
