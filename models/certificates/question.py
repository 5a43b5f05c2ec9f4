"""What is asked of a joint's target: its greatest value, slope or change over a box."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.observation_box import COUNTED, ObservationBox
from glassgait.models.task.observation import entries_of

Tree = list
"""A split: [quantity, cut, tree below, tree above]; an empty list where nothing is split."""


@dataclass(frozen=True)
class Box:
    """A box of quantities, in the robot's units.

    Attributes:
        lower: Least quantities (n).
        upper: Greatest quantities (n).
        counted: Quantities that are whole numbers.
    """

    lower: Array
    upper: Array
    counted: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Maximum:
    """What is known of the greatest value of a function over a box.

    Attributes:
        bound: No value is greater.
        reached: Value at the witness.
        witness: Quantities in the box (n).
        splits: The cells that the bound was found over.
    """

    bound: float
    reached: float
    witness: Array
    splits: Tree = field(default_factory=list)


Of = Literal["target", "offset", "slope", "effect"]


@dataclass(frozen=True)
class BoundQuery:
    """How great something can be over a box.

    Attributes:
        of: The joint's `target` (rad); its `offset` from where the joint is (rad), which times the
            stiffness is the torque at rest; its `slope` by an observation (rad per unit); or the
            `effect` of an observation alone: the target less the target with another value of it
            (rad).
        state: State of the reward machine.
        joint: Index of the joint.
        sign: 1 for the greatest value, -1 for the greatest negative.
        observation: Index of the observation, for slope and effect.
    """

    of: Of
    state: int
    joint: int
    sign: int
    observation: int | None = None


def region_of(box: ObservationBox, state: int) -> Box:
    """Returns a box in the robot's units, with the machine's state held."""
    lower, upper = box.in_state(state).quantities
    return Box(lower, upper, counted_of(box.names))


def counted_of(names: Sequence[str]) -> frozenset[int]:
    """Returns the observations that are whole numbers."""
    entries = enumerate(entries_of(names))
    return frozenset(index for index, entry in entries if entry.group in COUNTED)


def with_copy(region: Box, index: int) -> Box:
    """Returns a box with another value of one quantity behind all others."""
    counted = region.counted | ({len(region.lower)} if index in region.counted else frozenset())
    lower, upper = (np.append(own, own[index]) for own in (region.lower, region.upper))
    return Box(lower, upper, counted)


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

    question: BoundQuery
    place: Place
    found: Maximum
    rounding: float = 0.0

    @property
    def bound(self) -> float:
        """What is asked, times its sign, is at most this, even in double precision."""
        return self.found.bound + self.rounding
