"""Limits that come last between a policy and the joints, read anew, and what they guarantee.

A target is clipped to within `reach` of the measured angle, then to within `reach` of the target
before, then into the joint's range less a margin; where not all that is asked and read is finite it
stays as it is. What comes last holds always. A clip into an interval that holds the target before
brings the new one no further from it. And two intervals of half-width `reach` meet where their
middles are within twice that of each other, as they are while the reading moves by `reach` a step
at most. Beyond the lean what is clipped is the measured angle itself.
"""

import math
from typing import Any, NamedTuple

from .robot import JOINTS, Robot, is_number, refuse_unless

FALL = 60.0
"""Lean of the trunk that is a fall (degrees)."""

KEEPS = ("range", "rate", "torque", "finite", "lean")
ROUNDING = 1e-9


class Limits(NamedTuple):
    """Stiffness (N·m/rad), margin (rad) and lean (degrees)."""

    stiffness: float
    margin: float = 0.02
    lean: float = 60.0

    @classmethod
    def of(cls, said: Any) -> "Limits":
        """Takes what a header says."""
        sound = isinstance(said, dict) and {"stiffness"} <= {*said} <= {*cls._fields}
        refuse_unless(sound and all(map(is_number, said.values())), "the policy's limits are none")
        own = cls(**{key: float(value) for key, value in said.items()})
        refuse_unless(
            0.01 <= own.stiffness <= 1000.0 and 0.0 <= own.margin <= 0.2 and 0.0 < own.lean <= 90.0,
            "the policy's limits are out of range",
        )
        return own

    def check(self, robot: Robot) -> None:
        """Refuses limits that the first target, the default stance, is beyond."""
        for joint in JOINTS:
            low, high = robot.limits[joint]
            within = low + self.margin <= robot.stance[joint] <= high - self.margin
            refuse_unless(within, f"the default stance of {joint} is beyond the policy's limits")

    def keep(self, claim: dict[str, Any], robot: Robot, joint: str) -> bool:
        """Returns whether a joint's target keeps to what a claim says."""
        reach, most = robot.effort[joint] / self.stiffness, claim.get("most", math.nan)
        full = robot.effort[joint] if math.isnan(most) else most
        match claim["keeps"]:
            case "range":
                return self.margin >= 0.0
            case "rate":
                own = robot.effort[joint] / robot.stiffness if math.isnan(most) else most
                return reach <= own + ROUNDING
            case "torque":
                return robot.stiffness * reach <= full + ROUNDING
            case "lean":
                return self.lean <= (FALL if math.isnan(most) else most)
            case _:
                return True
