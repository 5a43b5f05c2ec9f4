"""Answering a question about any policy that can be searched."""

from dataclasses import dataclass
from typing import Protocol

from glassgait.models.counterfactuals.question import Answer, Question
from glassgait.models.errors import InputError
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped


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
