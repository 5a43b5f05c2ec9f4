"""Limits of joint targets that come last and hold whatever a policy asks for.

As formula files hold them, of each joint:

    reach = torque/stiffness
    wanted = asked if g.z < -cos(lean) else q
    weak = clip(wanted, q - reach, q + reach)
    slow = clip(weak, before - reach, before + reach)
    target = clip(slow, lowest + margin, highest - margin)

`asked` is what the policy asks for, `before` the target of the step before, `q` the measured angle,
all in rad; the first target is the default stance. Where not all angles and all that is asked are
finite, every joint keeps its target.

From the order of these lines it follows, whatever a policy asks and however its sensors fail:

- **Range.** A target is from `lowest + margin` to `highest - margin`, the first one as well.
- **Rate.** It moves by `reach` in a step at most: the last line brings a target nearer to the one
  before, which was within its limits.

And as long as all that is asked and read is finite:

- **Torque.** A target that is within `reach` of the reading stays so, while the reading moves by
  `reach` a step at most and is within `reach` of the limits: at rest the joint asks its motor for
  no more torque than it has. For the target before is then within twice `reach` of the reading, and
  the two intervals meet. A robot that starts, or a reading that jumps, further away is met by
  `reach` a step.
- **Lean.** Where the trunk leans by more than `lean`, a joint is sent to where it is, or as near to
  it as limits allow, so that its motor damps it and does nothing else.
"""

import math
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError
from glassgait.models.robots.quadruped import JOINTS
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings, checked

Margin = Annotated[float, Ge(0.0), Le(0.2)]
Lean = Annotated[float, Gt(0.0), Le(90.0)]
Stiffness = Annotated[float, Ge(0.01), Le(1000.0)]


@checked
class TargetLimits(Settings):
    """Limits of joint targets.

    Attributes:
        stiffness: Stiffness that torques at rest are computed with (N·m/rad).
        margin: Distance of targets from the ends of a joint's range (rad); by default the greatest
            error of an encoder in training.
        lean: Angle of the trunk beyond which joints are only damped (°); by default that of a fall.
    """

    title: ClassVar[str] = "limits"

    stiffness: Stiffness
    margin: Margin = 0.02
    lean: Lean = 60.0

    @cached_property
    def upright(self) -> float:
        """Greatest upward part of gravity's direction at which policies act."""
        # Rounded, so that the C of a lean of 60° reads -0.5.
        return -round(math.cos(math.radians(self.lean)), 12)

    def check(self, robot: Robot) -> None:
        """Refuses a robot whose default stance, from which robots start, is beyond the limits."""
        least, greatest = self.ends(robot)
        for joint, low, high in zip(JOINTS, least, greatest, strict=True):
            if not low <= 0.0 <= high:
                raise InputError(
                    f"limits: the {robot.name}'s default stance has {joint} nearer to the end of "
                    f"its range than a margin of {self.margin:g} rad; give a smaller margin"
                )

    def reach(self, robot: Robot) -> Array:
        """Returns the greatest distance of targets from joints and from targets before (12)."""
        return robot.effort / self.stiffness / robot.action_scale

    def ends(self, robot: Robot) -> tuple[Array, Array]:
        """Returns the least and the greatest actions (12 each)."""
        stance, scale = robot.default_stance, robot.action_scale
        least = (robot.lower_limits + self.margin - stance) / scale
        return least, (robot.upper_limits - self.margin - stance) / scale

    def applied(
        self, robot: Robot, action: Array, *, before: Array, position: Array, gravity: Array
    ) -> Array:
        """Returns the actions (..., 12) that the limits leave.

        An action that no limit touches is returned to the last digit.

        Args:
            action: What a policy asks for (..., 12).
            before: The actions of the step before (..., 12), within the limits.
            position: Measured joint positions (..., 12; rad).
            gravity: Measured direction of gravity in the trunk's frame (..., 3).
        """
        here = (position - robot.default_stance) / robot.action_scale
        reach, (least, greatest) = self.reach(robot), self.ends(robot)
        is_upright = gravity[..., 2:] < self.upright
        limited = np.where(is_upright, action, here)
        limited = clip(limited, here - reach, here + reach)
        limited = clip(limited, before - reach, before + reach)
        limited = clip(limited, least, greatest)
        finite = np.isfinite(action + position).all(axis=-1, keepdims=True)
        return np.where(finite, limited, before)
