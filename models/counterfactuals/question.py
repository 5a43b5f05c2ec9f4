"""Questions about a joint's target, what observations may be instead, and their answers."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import Group, entries_of

TOLERANCE = 0.01
"""Share of its distance by which an answer called nearest may be farther than the nearest."""

HELD: tuple[Group, ...] = (
    "commanded velocity",
    "machine state",
    "iterations",
    "commanded iterations",
)
"""Groups of observations that are known, not sensed, and stay as they are."""

_MARGIN = 1e-9
"""What is asked beyond the question, so that rounding errors leave it answered (rad)."""


@dataclass(frozen=True)
class Room:
    """What each observation may be instead, and how far away that is.

    Attributes:
        spread: Unit of distance of each observation (n); 0 of one that is held.
        lower: The least it may be (n).
        upper: The greatest it may be (n).
    """

    spread: Array
    lower: Array
    upper: Array

    @classmethod
    def of(cls, names: Sequence[str], observations: Array, commands: Gait | None = None) -> Self:
        """Returns the room that a rollout has measured.

        A distance is counted in standard deviations over the rollout, and the range is the
        rollout's. Commands, the machine's state and its iterations are held.

        Args:
            names: Names of the observations.
            observations: What was observed (m, n).
            commands: Lets the commanded speed and yaw rate be what the gait takes; a distance of
                theirs is counted in standard deviations of commands drawn from that range.

        Raises:
            InputError: if a name is unknown.
        """
        spread = observations.std(axis=0)
        lower, upper = observations.min(axis=0), observations.max(axis=0)
        for index, entry in enumerate(entries_of(names)):
            if entry.group == "commanded velocity" and commands is not None:
                own = commands.max_speed if entry.unit == "m/s" else commands.max_yaw_rate
                most = entry.factor * own
                spread[index], lower[index], upper[index] = most / np.sqrt(3.0), -most, most
            elif entry.group in HELD or spread[index] < 1e-9:
                spread[index] = 0.0
        return cls(spread, lower, upper)

    @cached_property
    def free(self) -> NDArray[np.intp]:
        """Indices of the observations that may differ."""
        return np.flatnonzero(self.spread > 0)

    def limits(self, observation: Array) -> tuple[Array, Array]:
        """Returns how far the free observations may go down and up (k; 0 or less, 0 or more)."""
        free, here = self.free, observation[self.free]
        down = np.minimum(self.lower[free] - here, 0.0) / self.spread[free]
        return down, np.maximum(self.upper[free] - here, 0.0) / self.spread[free]


@dataclass(frozen=True)
class Question:
    """What would a policy have had to observe to change a joint's target by so much?

    Attributes:
        policy: The policy.
        joint: Index of the joint.
        observation: What was observed (n).
        by: By how much the target is to change, or more (rad); negative is down.
        room: What may be observed instead.
    """

    policy: Policy
    joint: int
    observation: Array
    by: float
    room: Room

    @property
    def sign(self) -> float:
        """1 where the target is to rise, -1 where it is to fall."""
        return 1.0 if self.by > 0 else -1.0

    @property
    def need(self) -> float:
        """By how much the target must go that way (rad)."""
        return abs(self.by) + _MARGIN

    def change_of_target(self, observations: Array) -> Array:
        """Returns by how much other observations (..., n) change the joint's target (...; rad)."""
        action = self.policy(observations)[..., self.joint]
        before = self.policy(self.observation)[self.joint]
        return self.policy.robot.action_scale * (action - before)

    def distance(self, observation: Array) -> float:
        """Returns how far another observation (n) is, in spreads."""
        free = self.room.free
        change = (observation - self.observation)[free] / self.room.spread[free]
        return float(np.linalg.norm(change))


@dataclass(frozen=True)
class Answer:
    """Another observation, which does what was asked.

    Attributes:
        observation: The observation (n).
        changed: Indices of those entries that differ.
        change_of_target: By how much the policy itself then changes the target (rad).
        distance: How far the observation is, in spreads.
        bound: No observation that does it, among those that the answer was sought, is nearer.
    """

    observation: Array
    changed: NDArray[np.intp]
    change_of_target: float
    distance: float
    bound: float

    @property
    def gap(self) -> float:
        """The share of the distance that a nearer answer might spare."""
        return 0.0 if self.distance == 0 else max(0.0, 1.0 - self.bound / self.distance)

    @property
    def proved(self) -> bool:
        """Whether no nearer answer is missed, to the tolerance."""
        return self.distance <= (1.0 + TOLERANCE) * self.bound + _MARGIN


def moved(question: Question, moves: Array) -> Array:
    """Returns the observation (n) whose free entries have moved (k, in spreads)."""
    room, observation = question.room, question.observation.copy()
    going = np.flatnonzero(moves)
    index = room.free[going]
    there = observation[index] + moves[going] * room.spread[index]
    observation[index] = np.clip(there, room.lower[index], room.upper[index])
    return observation


def answered(question: Question, observation: Array, bound: float) -> Answer | None:
    """Makes an answer, and asks the policy itself whether it is one.

    Args:
        question: The question.
        observation: Another observation (n).
        bound: What its distance is known to be at least.

    Returns:
        The answer; None where the policy says otherwise.
    """
    change = float(question.change_of_target(observation))
    if question.sign * change < abs(question.by):
        return None
    changed = np.flatnonzero(observation != question.observation)
    distance = question.distance(observation)
    return Answer(observation, changed, change, distance, min(bound, distance))


class Search(Protocol):
    """What looks for answers to one question."""

    def nearest(self) -> Answer | None:
        """Returns the nearest answer, with a bound of how near another might be; None if none."""
        ...

    def fewest(self) -> Answer | None:
        """Returns the nearest answer that changes one observation, or else two; None if none."""
        ...

    def reach(self) -> float:
        """Returns the greatest rise, or fall, that is found (rad)."""
        ...


@dataclass(frozen=True)
class Answers:
    """Both answers to a question.

    Attributes:
        nearest: The nearest of all.
        fewest: The nearest that changes one observation, or else two; None if more must differ.
    """

    nearest: Answer
    fewest: Answer | None


def answer(question: Question) -> Answers:
    """Answers a question.

    Raises:
        InputError: if policies of this kind are not searched, or nothing that may be observed does
            what is asked.
    """
    search = search_of(question)
    nearest = search.nearest()
    if nearest is None:
        way = "rise" if question.by > 0 else "fall"
        raise InputError(
            f"--by {question.by:g}: no observation within the range measured lets the target of "
            f"{quadruped.JOINTS[question.joint]} {way} so much; the most that was found is "
            f"{question.sign * search.reach():.3f} rad, so ask for less or name another --step"
        )
    return Answers(nearest, search.fewest())


def search_of(question: Question) -> Search:
    """Returns what looks for answers, by the kind of the policy.

    Raises:
        InputError: if policies of this kind are not searched.
    """
    refuse_unsearched(question.policy)
    return question.policy.capabilities.function("search")(question)


def refuse_unsearched(policy: Policy) -> None:
    """Refuses policies of kinds that are not searched.

    Raises:
        InputError: if this is one.
    """
    if policy.capabilities.search is None:
        raise InputError(
            f"policies of kind {policy.kind!r} cannot be searched for counterfactuals; take a "
            "linear or symbolic one, an additive one, or a GBM"
        )


@dataclass(frozen=True)
class Intervention:
    """A change of the observation that a policy is given, while the robot is as it is.

    Attributes:
        offset: What is added to the observation (n).
        first: The control step at which it begins.
        count: For how many control steps it lasts.
    """

    offset: Array
    first: int
    count: int = 1

    def applied(self, step: int, observation: Array) -> Array:
        """Returns what the policy is given (..., n) at a control step, of an observation."""
        lasts = self.first <= step < self.first + self.count
        return observation + self.offset if lasts else observation
