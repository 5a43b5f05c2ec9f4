"""A student that acts inside of its region, and an expert that acts outside."""

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.alternating import AlternatingPolicy, Turn
from glassgait.models.policies.policy import Policy, refuse_other_estimator
from glassgait.models.robots.robot import Robot
from glassgait.models.task.assurance import Guard, Hysteresis, Region, initial_guard, step_guard


@dataclass(frozen=True)
class AssuredPolicy:
    """A student under runtime assurance.

    It remembers nothing itself: `advance` takes what it is told of the step before and returns what
    the next one is to be told, each robot's own.

    Attributes:
        expert: Who acts outside of the region; its estimator, if it has one, observes for both.
        student: Who acts inside.
        region: Where the student may act.
        hysteresis: When to call the expert, and when to let it go.
    """

    expert: Policy
    student: Policy
    region: Region
    hysteresis: Hysteresis

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if the region is of other observations than the student's, or the student
                observes by the estimator of another expert.
        """
        refuse_other_estimator(self.expert, self.student)
        if self.region.names != self.student.observation_names:
            raise InputError(
                "assurance: the region is of other observations than the student's; measure it "
                f"with robots of the {self.student.gait}"
            )

    def begin(self, n_robots: int) -> Guard:
        """Returns what the first step of an episode is told."""
        return initial_guard((n_robots,))

    def advance(self, step: int, observation: Array, guard: Guard) -> Turn:
        """Acts at a control step, whatever its number, and tells who did.

        Args:
            step: Control step of the episode.
            observation: Observations (n, n_obs).
            guard: What the step before returned, or `begin`.
        """
        guard = step_guard(guard, self.region.overrun(observation), self.hysteresis)
        called = guard.expert_acts
        action = np.array(self.student(observation))
        if called.any():
            action[called] = self.expert(observation[called])
        return Turn(action, called, guard)

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
        """Whether joints follow targets within their ranges alone: if the expert learned so."""
        return self.expert.limits_targets

    def settings(self) -> dict[str, Any]:
        """Returns all that changes the actions but the policies, as values that JSON can hold."""
        corners = np.ascontiguousarray([self.region.lower, self.region.upper])
        told = {
            "hysteresis": asdict(self.hysteresis),
            "region": hashlib.sha256(corners.tobytes()).hexdigest()[:16],
        }
        doubt = self.region.doubt
        return told | {"usual_doubt": doubt.usual.tolist()} if doubt else told

    @property
    def acting_expert(self) -> Policy:
        """The expert."""
        return self.expert

    @property
    def acting_student(self) -> Policy:
        """The student."""
        return self.student


ActingPolicy = AlternatingPolicy | AssuredPolicy
"""Who acts in a closed loop: an expert, a student, or both by a schedule or under assurance."""


def estimator_in_loop(
    policy: ActingPolicy | Policy, *, true_body_state: bool = False
) -> Callable[[Array], Array] | None:
    """Returns what gives a policy its body state in a closed loop: the diagram's or the batch's.

    Args:
        policy: Who acts.
        true_body_state: Whether it is to observe the true body state, as a scenario says.

    Returns:
        The policy's estimator, or None for the true body state.

    Raises:
        InputError: if the policy has no estimator, and the true body state is not asked for.
    """
    if true_body_state:
        return None
    if policy.estimator is None:
        alone = policy if isinstance(policy, Policy) else policy.expert
        raise InputError(
            f"this {alone.kind} policy of the {alone.gait} has no estimator of the body state; "
            "take it from load_student, give it the expert's with "
            "policy.with_estimator_of(expert), or set true_body_state: true in the scenario"
        )
    return policy.estimator
