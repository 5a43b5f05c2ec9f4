"""What is proved of one joint in one state: a bound over a box, and a witness near it."""

from dataclasses import dataclass

from glassgait.models.certificates.maximum import Maximum
from glassgait.models.certificates.question import Question


@dataclass(frozen=True)
class Place:
    """Where something is proved.

    Attributes:
        box: Name of the box, "operating" or "physical".
        stuck: Observations, by index, that are anywhere in the physical box instead.
    """

    box: str
    stuck: tuple[int, ...] = ()


@dataclass(frozen=True)
class Statement:
    """A question and what is known of its answer.

    Attributes:
        question: What is asked.
        place: Where.
        found: The answer, of the exact target.
        rounding: What double precision may add to it (rad).
    """

    question: Question
    place: Place
    found: Maximum
    rounding: float = 0.0

    @property
    def bound(self) -> float:
        """What is asked, times its sign, is at most this, even in double precision."""
        return self.found.bound + self.rounding

    @property
    def gap(self) -> float:
        """Distance of the bound from what a witness reaches."""
        return self.found.bound - self.found.reached
