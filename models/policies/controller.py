"""Controllers: one policy, or an expert and a student in alternation."""

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
"""Odometry, or a function from proprioception (..., 40 + n_states) to the body state (..., 7)."""


class ControllerOutput(NamedTuple):
    """Actions (n, 12) at a control step, whether they are the expert's (n,), and its memory."""

    action: Array
    expert_acts: NDArray[np.bool_]
    memory: Array  # (n, n_memory), for the next control step


@dataclass(frozen=True)
class Controller:
    """An expert, a student, or both in alternation (paper, Algorithm 1)."""

    expert: Policy
    student: Policy | None = None
    period: int = 1
    """The expert acts at control steps that are multiples of the period, the student at all others.
    The alternation ratio is 1/period; with period 0 only the student acts."""

    def __post_init__(self) -> None:
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
        """The policies that act, by the names `expert` and `student`."""
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
        estimator = self.student.estimator if self.student and self.period == 0 else None
        return estimator if isinstance(estimator, Odometry) else self.expert.estimator

    @property
    def joint_law(self) -> JointLaw:
        law = self.expert.joint_law
        return law if self.student is None or self.period else self.student.joint_law.merged(law)

    def refuse_other_machine(self, gait: Gait) -> None:
        for policy in self.policies.values():
            policy.refuse_other_machine(gait)

    def begin(self, n_robots: int) -> Array:
        """Returns the expert's memory (n, n_memory) before the first step."""
        return np.full((n_robots, self.expert.n_memory), np.nan)

    def advance(
        self, step: int, observation: Array, memory: Array | None = None
    ) -> ControllerOutput:
        """Acts on observations (n, n_obs) at a control step, counted from the episode's start.

        `memory` is that of the previous step, by default that before the first one.
        """
        # The same policy acts on all robots. The expert also remembers steps at which students act.
        by_expert = self.student is None or expert_acts(step, self.period)
        before = self.begin(len(observation)) if memory is None else memory
        memory = self.expert.remember(before, observation)
        policy = self.expert if self.student is None or by_expert else self.student
        action = policy(memory if policy is self.expert else observation)
        return ControllerOutput(action, np.full(len(observation), by_expert), memory)


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
            f"the policy is {shown(policy)}; give a Policy, a Controller, or a function from "
            "observations (..., n) to actions (..., 12)"
        )
    return Controller(FunctionPolicy(policy, gait, robot))


def alone(policy: Policy, expert: Policy | None = None) -> Controller:
    """Returns the controller of one policy; a student may use the estimator of its expert."""
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
    """Returns the estimator of a closed loop; None if the true body state is observed."""
    if true_body_state:
        return None
    if controller.estimator is None:
        policy = expert_of(controller)
        raise InputError(
            f"this {policy.kind} policy of the {policy.gait} has no estimator of the body state; "
            "load it with load_student, or set true_body_state: true in the scenario"
        )
    return controller.estimator


def _refuse_other_expert(expert: Policy, student: Policy, *, both_act: bool) -> None:
    # A student needs the estimator that it was distilled with.
    name = f"this {student.kind} student of the {student.gait}"
    if student.remembers:
        raise InputError(f"{name} remembers observations, which only experts do; give another one")
    if student.gait != expert.gait:
        raise InputError(f"{name} cannot act with an expert of the {expert.gait}; give another one")
    if student.observes_by not in (None, expert.digest()):
        raise InputError(
            f"{name} uses the estimator of the expert {student.observes_by}, not of "
            f"{expert.digest()}; give it the expert that it was distilled with"
        )
    if not both_act:
        return

    # In alternation, both must share the estimator, the gains and the target limits.
    estimator, law = student.estimator, student.joint_law.merged(expert.joint_law)
    robot, expert_law, problem = expert.robot, expert.joint_law, None
    if isinstance(estimator, Odometry) and estimator != expert.estimator:
        problem = "has odometry, which is not the estimator of"
    elif (gains := law.gains_of(robot)) != (expert_gains := expert_law.gains_of(robot)):
        problem = f"has joint gains {gains}, not {expert_gains} as"
    elif law.limits != expert_law.limits:
        problem = "has other target limits than"
    if problem:
        raise InputError(f"{name} {problem} the expert that acts with it; let only one of them act")
