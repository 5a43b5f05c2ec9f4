"""Controllers: one policy that acts, or an expert and a student in alternation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.function import FunctionPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import JointLaw, Robot
from glassgait.models.task.alternation import expert_acts
from glassgait.models.task.gait import Gait

Estimator = Callable[[Array], Array] | Odometry
"""Odometry, or the map from proprioception (..., 40 + n_states) to the body state (..., 7)."""


class ControllerOutput(NamedTuple):
    """Actions (n, 12) at a control step, and whether they are the expert's (n,)."""

    action: Array
    expert_acts: NDArray[np.bool_]


@dataclass(frozen=True)
class Controller:
    """An expert, a student, or both in alternation (paper, Algorithm 1)."""

    expert: Policy
    student: Policy | None = None
    period: int = 1
    """The expert acts at every control step that is a multiple of it, the student at the others:
    n is the alternation ratio 1/n, 1 the expert without the student, 0 the student without it."""

    def __post_init__(self) -> None:
        for policy in (self.expert, self.student):
            if not isinstance(policy, Policy | None):
                raise InputError(
                    f"the controller is given {shown(policy)}; give a policy, or turn a function "
                    "into one by FunctionPolicy(function, gait)"
                )
        if not isinstance(self.period, (int, np.integer)) or self.period < 0:
            raise InputError(
                f"the alternation period is {shown(self.period)}; give a whole number of control "
                "steps: n for the ratio 1/n, 1 for the expert only, 0 for the student only"
            )
        if self.student is None and self.period != 1:
            raise InputError(f"an alternation of period {self.period} needs a student; give one")
        if self.student is not None:
            _refuse_other_expert(self.expert, self.student, both_act=self.period > 1)

    @property
    def policies(self) -> dict[str, Policy]:
        """Those of `expert` and `student` that ever act, by these names."""
        acting = {} if self.period == 0 else {"expert": self.expert}
        if self.student is None or self.period == 1:
            return acting
        return acting | {"student": self.student}

    @property
    def policy(self) -> Policy:
        """The only policy that acts; raises ValueError if two do."""
        (policy,) = self.policies.values()
        return policy

    @property
    def robot(self) -> Robot:
        return self.expert.robot

    @property
    def estimator(self) -> Estimator | None:
        """The estimator: the expert's, unless only a student with odometry acts."""
        found = self.student.estimator if self.student and self.period == 0 else None
        return found if isinstance(found, Odometry) else self.expert.estimator

    @property
    def joint_law(self) -> JointLaw:
        law = self.expert.joint_law
        return law if self.student is None or self.period else self.student.joint_law.merged(law)

    def refuse_other_machine(self, gait: Gait) -> None:
        for policy in self.policies.values():
            policy.refuse_other_machine(gait)

    def advance(self, step: int, observation: Array) -> ControllerOutput:
        """Acts on observations (n, n_obs) at a control step, counted from the episode's start."""
        # At a step all robots have the same controller.
        by_expert = self.student is None or bool(expert_acts(step, self.period))
        policy = self.expert if self.student is None or by_expert else self.student
        return ControllerOutput(policy(observation), np.full(len(observation), by_expert))


def controller_of(
    policy: Controller | Callable[[Array], Array], gait: Gait, robot: Robot
) -> Controller:
    """Returns the controller of a policy, or of a function for this gait and robot."""
    if isinstance(policy, Controller):
        return policy
    if isinstance(policy, Policy):
        return Controller(policy)
    if not callable(policy):
        raise InputError(
            f"the policy is {shown(policy)}; give one that load_expert, load_student or, for a "
            "file, load_policy returns, a Controller, or a function from observations (..., n) to "
            "actions (..., 12)"
        )
    return Controller(FunctionPolicy(policy, gait, robot))


def alone(policy: Policy, expert: Policy | None = None) -> Controller:
    """Returns the controller in which one policy acts; a student may observe by its expert."""
    if expert is None or expert is policy:
        return Controller(policy)
    has_odometry = isinstance(policy.estimator, Odometry)
    if has_odometry and expert.observation_names != policy.observation_names:
        return Controller(policy)
    return Controller(expert, policy, period=0)


def expert_of(controller: Controller | Policy) -> Policy:
    return controller if isinstance(controller, Policy) else controller.expert


def estimator_in_loop(
    controller: Controller | Policy, *, true_body_state: bool = False
) -> Estimator | None:
    """Returns the estimator of a closed loop; None where the true body state is observed."""
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


def _refuse_other_expert(expert: Policy, student: Policy, *, both_act: bool) -> None:
    # The student was distilled with one estimator, and observes by no other.
    name = f"this {student.kind} student of the {student.gait}"
    if student.gait != expert.gait:
        raise InputError(f"{name} does not act beside an expert of the {expert.gait}; name another")
    if student.observes_by not in (None, expert.digest()):
        raise InputError(
            f"{name} observes by the estimator of the expert {student.observes_by}, not by that of "
            f"{expert.digest()}; give it the expert that it was distilled with"
        )
    if not both_act:
        return

    # One robot cannot observe in two ways, or hold its joints by two laws, by turns.
    estimator, law = student.estimator, student.joint_law.merged(expert.joint_law)
    robot, theirs, differs = expert.robot, expert.joint_law, None
    if isinstance(estimator, Odometry) and estimator != expert.estimator:
        differs = "has odometry, which is not the estimator of"
    elif law.gains_of(robot) != theirs.gains_of(robot):
        differs = f"moves joints of gains {law.gains_of(robot)}, not {theirs.gains_of(robot)} as"
    elif law.limits != theirs.limits:
        differs = "has other limits of its targets than"
    if differs:
        raise InputError(f"{name} {differs} the expert that acts with it; let only one of them act")
