"""Ranges in which formulas read what a robot senses, as formula files hold them.

Where a sensor says more, formulas read the end of its range that is nearer. So one that is stuck
moves a target no further than it did where robots were measured.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.task.observation import (
    Group,
    ObservationEntry,
    ObservationLayout,
    entries_of,
)

SENSED: tuple[Group, ...] = (
    "commanded velocity",
    "joint position",
    "joint velocity",
    "gravity",
    "angular velocity",
    "base velocity",
    "foot height",
)
"""Groups of what may have a range: all but the robot's own targets, counts and machine state."""

LIMITED: tuple[Group, ...] = (
    "commanded velocity",
    "joint position",
    "joint velocity",
    "angular velocity",
    "foot height",
)
"""Groups that have one by default: what is said by one sensor, or is commanded.

Gravity's direction and the velocity are left as they are: formulas that do not see how far a slope
or a push has taken the robot fall more often.
"""

DIGITS = 2
"""Digits of an end, behind the first digit of its range's width."""

Range = tuple[float, float]


@dataclass(frozen=True)
class Readings:
    """Ranges of what formulas read.

    All legs share a range, and what changes its sign in a mirror that exchanges left and right has
    one that does not change: so a policy is its own mirror image with these, if it is without.

    Attributes:
        ranges: Least and greatest value of each kind that has a range, such as "q.hip", in the
            robot's units; of a hip those of left ones.
    """

    ranges: tuple[tuple[str, Range], ...]

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if a range is empty or not finite, is given twice, or has an image in the
                mirror.
        """
        # In whichever order ranges are written, they are the same.
        known = {kind: place for place, kind in enumerate(KINDS)}
        ordered = sorted(self.ranges, key=lambda own: known.get(own[0], len(known)))
        ranges = tuple((kind, (float(low), float(high))) for kind, (low, high) in ordered)
        object.__setattr__(self, "ranges", ranges)
        if len(self._by_kind) < len(ranges):
            raise InputError("a range is given twice; leave one out")
        for kind, (low, high) in ranges:
            if not -math.inf < low < high < math.inf:
                raise InputError(
                    f"{kind} is read from {low:g} to {high:g}; give the least, then the greatest"
                )
            if kind in _TURNING and low != -high:
                raise InputError(
                    f"{kind} is read from {low:g} to {high:g}, and in a mirror from {-high:g} to "
                    f"{-low:g}; give a range that is both, such as from {-max(-low, high):g} to "
                    f"{max(-low, high):g}"
                )

    @classmethod
    def around(cls, names: Sequence[str], lower: Array, upper: Array) -> Self:
        """Returns the ranges of `LIMITED` that hold a box, their ends rounded outward.

        Args:
            names: Names of the observations (n).
            lower: Least quantities of the box (n), in the robot's units.
            upper: Greatest ones (n).
        """
        hulls: dict[str, Range] = {}
        for entry, low, high in zip(entries_of(names), lower, upper, strict=True):
            kind = kind_of(entry)
            if entry.group not in LIMITED:
                continue
            ends = (-high, -low) if _is_turned(entry) else (low, high)
            ends = (min(ends[0], -ends[1]), max(-ends[0], ends[1])) if kind in _TURNING else ends
            known = hulls.get(kind, ends)
            hulls[kind] = float(min(known[0], ends[0])), float(max(known[1], ends[1]))
        return cls(tuple((kind, _outward(*hull)) for kind, hull in hulls.items()))

    def ends(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Returns the least and the greatest of each quantity (n, n), infinite where it has none.

        Args:
            names: Names of the observations (n).
        """
        ends = np.array([self._ends_of(entry) for entry in entries_of(names)])
        return ends[:, 0], ends[:, 1]

    def refuse_others(self, names: Sequence[str]) -> None:
        """Refuses ranges that are not of what is observed.

        Raises:
            InputError: if one is of nothing that is observed.
        """
        known = {kind_of(entry) for entry in entries_of(names)}
        if other := [kind for kind in self._by_kind if kind not in known]:
            imu = ", or add 'senses: imu' to the header" if other[0] in KINDS else ""
            raise InputError(f"nothing that is sensed is called {other[0]!r}; leave it out{imu}")

    @cached_property
    def _by_kind(self) -> Mapping[str, Range]:
        return dict(self.ranges)

    def _ends_of(self, entry: ObservationEntry) -> Range:
        low, high = self._by_kind.get(kind_of(entry), (-math.inf, math.inf))
        return (-high, -low) if _is_turned(entry) else (low, high)


def kind_of(entry: ObservationEntry) -> str:
    """Returns the kind whose range is an observation's, such as "q.hip"; nothing if none is."""
    if entry.group not in SENSED:
        return ""
    if entry.leg is None:
        return entry.symbol
    return re.sub(rf"\.{entry.leg}_?", ".", entry.symbol).rstrip(".")


def _is_turned(entry: ObservationEntry) -> bool:
    """Returns whether an observation is of a right leg, and of the other sign there."""
    return entry.mirror_sign < 0.0 and entry.leg is not None and entry.leg.endswith("R")


KINDS = tuple(
    dict.fromkeys(
        kind for entry in ObservationLayout(1, imu=True).entries if (kind := kind_of(entry))
    )
)
"""All kinds, in the order in which they are observed."""

_TURNING = frozenset(
    entry.symbol
    for entry in ObservationLayout(1, imu=True).entries
    if entry.leg is None and entry.mirror_sign < 0.0
)
"""Kinds that change their sign in the mirror, such as "g.y"."""


def _outward(low: float, high: float) -> Range:
    step = 10.0 ** (math.floor(math.log10(max(high - low, 1e-6))) - DIGITS)
    # What is off the last digit by rounding alone is on it.
    first, last = math.floor(low / step + 1e-6), math.ceil(high / step - 1e-6)
    # A factor of whole numbers has no digits of its own.
    return float(f"{first * step:.12g}"), float(f"{last * step:.12g}")
