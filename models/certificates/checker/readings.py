"""Ranges in which formulas read what a robot senses, read anew.

Where a sensor says more, a formula reads the nearer end. So a box of what is sensed is, to a
formula, the box of what is read of its ends: what is proved over that one holds over the first.
"""

import math
import re
from typing import Any, NamedTuple

from .robot import TURNED, Box, is_number, refuse_unless


class Readings(NamedTuple):
    """Least and greatest value of each quantity that has a range."""

    ends: dict[str, tuple[float, float]]

    @classmethod
    def of(cls, said: Any, names: list[str]) -> "Readings":
        """Takes what the header of a policy of these quantities says."""
        refuse_unless(isinstance(said, dict), "the policy's readings are none")
        for kind, ends in said.items():
            sound = isinstance(ends, list) and len(ends) == 2 and all(map(is_number, ends))
            refuse_unless(sound and ends[0] < ends[1], f"the range of {kind} is none")
        ends, used = dict[str, tuple[float, float]](), set[str]()
        for name in names:
            kind = kind_of(name)
            if kind is None or kind not in said:
                continue
            used.add(kind)
            low, high = map(float, said[kind])
            refuse_unless(
                name not in TURNED or low == -high, f"the range of {kind} has another in the mirror"
            )
            right_hip = re.search(r"\.[FR]R_hip$", name)
            ends[name] = (-high, -low) if right_hip else (low, high)
        refuse_unless(used == {*said}, "the policy's readings are of what is not observed")
        return cls(ends)

    def applied(self, box: Box) -> Box:
        """Returns what formulas read of a box."""
        read = dict(box)
        for name in self.ends.keys() & box.keys():
            low, high = self.ends[name]
            first, last = (min(max(end, low), high) for end in box[name])
            read[name] = first, last
        return read

    def reach(self, name: str, box: Box) -> tuple[bool, bool]:
        """Returns whether a box holds what lies in a quantity's range, and what lies beyond."""
        (low, high), (first, last) = self.ends.get(name, (-math.inf, math.inf)), box[name]
        return first <= high and last >= low, first < low or last > high

    def beyond(self, name: str, sign: int, box: Box) -> float:
        """Bounds how far below what is read of a quantity, or above, it is in a box."""
        (low, high), own = self.ends.get(name, (-math.inf, math.inf)), box[name]
        return max(0.0, low - own[0] if sign > 0 else own[1] - high)


def kind_of(name: str) -> str | None:
    """Returns the kind whose range is a quantity's; None of one that has none."""
    head, _, member = name.partition(".")
    if head in ("a", "t") or name == "cmd.t" or re.fullmatch(r"s[0-9]+", name):
        return None
    if head == "h":
        return "h"
    return f"{head}.{member.rpartition('_')[2]}"
