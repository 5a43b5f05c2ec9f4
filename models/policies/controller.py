"""Controllers: one policy alone, or an expert and a student that take turns at acting."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.policy import Policy, refuse_other_expert
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.robot import Robot
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.gait import Gait

Estimator = Callable[[Array], Array] | Odometry
"""Odometry, or what maps proprioception (..., 40 + n_states) to the body state (..., 7)."""


class ControllerOutput(NamedTuple):
    """What a controller returns at a control step, robots along the first axis.

    Attributes:
        action: Actions (n, 12).
        expert_acts: Whether they are the expert's (n,).
        memory: What the controller remembers until the next step.
    """

    action: Array
    expert_acts: NDArray[np.bool_]
    memory: Any


class Controller(ABC):
    """Acts in a closed loop, at every control step of n robots.

    A controller is a value: what it remembers is returned by `begin` and `advance`, and given to
    the next `advance`.

    Attributes:
        expert: The expert; its estimator, if it has one, observes for the student as well.
        student: The student, or None.
    """

    expert: Policy
    student: Policy | None

    @property
    @abstractmethod
    def policies(self) -> Mapping[str, Policy]:
        """Those of `expert` and `student` that ever act, by these names."""

    @property
    def robot(self) -> Robot:
        """The robot that it is made for."""
        return self.expert.robot

    @property
    def estimator(self) -> Estimator | None:
        """What estimates the body state; None where the true one is observed."""
        return self.expert.estimator

    @property
    def joint_law(self) -> JointLaw:
        """How joints follow targets: as the expert learned it."""
        return self.expert.joint_law

    def begin(self, n_robots: int) -> Any:
        """Returns the memory at the start of an episode; None where nothing is remembered."""
        return None

    @abstractmethod
    def advance(self, step: int, observation: Array, memory: Any) -> ControllerOutput:
        """Acts on observations (n, n_obs) at a control step, counted from the episode's start."""

    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """Returns all that changes the actions but the policies, as values that JSON can hold."""


@dataclass(frozen=True)
class AlternatingController(Controller):
    """An expert alone, a student alone, or both by turns (paper, Algorithm 1).

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
            InputError: if the student observes by the estimator of another expert, or by odometry
                of its own where the expert acts as well and has another estimator; or both act and
                their joints have different gains.
        """
        if self.student is not None:
            refuse_other_expert(self.expert, self.student, both_act=self.period > 1)
        if self.period < 0:
            raise ValueError(f"alternation: period is {self.period}; it must be 0 or more")
        if self.student is None and self.period != 1:
            raise ValueError(f"alternation: period {self.period} needs a student; give one")

    @property
    def policies(self) -> dict[str, Policy]:
        acting = {} if self.period == 0 else {"expert": self.expert}
        if self.student is None or self.period == 1:
            return acting
        return acting | {"student": self.student}

    @property
    def estimator(self) -> Estimator | None:
        """What estimates the body state; None where the true one is observed.

        It is the expert's, unless a student acts alone that has odometry of its own.
        """
        own = self.student.estimator if self.student and self.period == 0 else None
        return own if isinstance(own, Odometry) else self.expert.estimator

    @property
    def policy(self) -> Policy:
        """The policy that acts alone.

        Raises:
            ValueError: if two policies act.
        """
        (policy,) = self.policies.values()
        return policy

    @property
    def joint_law(self) -> JointLaw:
        """How joints follow targets: as the expert learned it, or a student that acts alone."""
        law = self.expert.joint_law
        return law if self.student is None or self.period else self.student.joint_law.over(law)

    def advance(self, step: int, observation: Array, memory: None) -> ControllerOutput:
        """Acts by the expert at every `period`-th step, and otherwise by the student."""
        by_expert = self.student is None or bool(expert_acts(step, self.period))
        policy = self.expert if self.student is None or by_expert else self.student
        return ControllerOutput(policy(observation), np.full(len(observation), by_expert), memory)

    def settings(self) -> dict[str, Any]:
        return {"period": self.period}


def alone(policy: Policy, expert: Policy | None = None) -> AlternatingController:
    """Returns the controller in which one policy acts alone.

    Args:
        policy: An expert or a student.
        expert: The expert whose estimator observes for a student; by default the policy's own
            estimator observes, and so it does where it is odometry and the expert observes other
            things.
    """
    if expert is None or expert is policy:
        return AlternatingController(policy)
    is_own = isinstance(policy.estimator, Odometry)
    if is_own and expert.observation_names != policy.observation_names:
        return AlternatingController(policy)
    return AlternatingController(expert, policy, period=0)


@dataclass(frozen=True)
class WrappedController(Controller):
    """Acts as another controller does; subclasses change what it observes or does.

    Attributes:
        inner: The other controller.
    """

    inner: Controller

    @property
    def expert(self) -> Policy:
        return self.inner.expert

    @property
    def student(self) -> Policy | None:
        return self.inner.student

    @property
    def policies(self) -> Mapping[str, Policy]:
        return self.inner.policies

    @property
    def estimator(self) -> Estimator | None:
        return self.inner.estimator

    @property
    def joint_law(self) -> JointLaw:
        return self.inner.joint_law

    def begin(self, n_robots: int) -> Any:
        return self.inner.begin(n_robots)

    def advance(self, step: int, observation: Array, memory: Any) -> ControllerOutput:
        return self.inner.advance(step, observation, memory)

    def settings(self) -> dict[str, Any]:
        return self.inner.settings()


def expert_of(controller: Controller | Policy) -> Policy:
    """Returns a controller's expert, or the policy that acts alone."""
    return controller if isinstance(controller, Policy) else controller.expert


def refuse_other_machine(controller: Controller | Policy | None, gait: Gait) -> None:
    """Refuses a gait for which a policy that acts was not made.

    Raises:
        InputError: as `Policy.refuse_other_machine`.
    """
    match controller:
        case None:
            return
        case Policy():
            controller.refuse_other_machine(gait)
        case _:
            for policy in controller.policies.values():
                policy.refuse_other_machine(gait)


def estimator_in_loop(
    controller: Controller | Policy, *, true_body_state: bool = False
) -> Estimator | None:
    """Returns what estimates the body state in a closed loop, the diagram's or the batch's.

    Args:
        controller: The controller, or the policy that acts alone.
        true_body_state: Whether it is to observe the true body state, as a scenario says.

    Returns:
        The controller's estimator, or None for the true body state.

    Raises:
        InputError: if the controller has no estimator, and the true body state is not asked for.
    """
    if true_body_state:
        return None
    if controller.estimator is None:
        policy = expert_of(controller)
        raise InputError(
            f"this {policy.kind} policy of the {policy.gait} has no estimator of the body state; "
            "take it from load_student, give it the expert's with "
            "policy.with_estimator_of(expert), or set true_body_state: true in the scenario"
        )
    return controller.estimator
