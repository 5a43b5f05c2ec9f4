"""The law by which joints follow a policy's targets, and the limits that come last."""

import math
from dataclasses import asdict, replace
from functools import cached_property
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError
from glassgait.models.robots.quadruped import JOINTS
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings, checked

Stiffness = Annotated[float, Gt(0.0), Le(1000.0)]
Damping = Annotated[float, Ge(0.0), Le(100.0)]
Gains = tuple[Stiffness, Damping]
"""Gains of the joints' position and velocity control (N·m/rad, N·m·s/rad)."""


@checked
class TargetLimits(Settings):
    """Limits of joint targets that come last and hold whatever a policy asks for.

    As formula files hold them, of each joint:

        reach = torque/stiffness
        wanted = asked if g.z < -cos(lean) else q
        weak = clip(wanted, q - reach, q + reach)
        slow = clip(weak, before - reach, before + reach)
        target = clip(slow, lowest + margin, highest - margin)

    `asked` is what the policy asks for, `before` the target of the step before, `q` the measured
    angle, all in rad; the first target is the default stance. Where not all angles and all that is
    asked are finite, every joint keeps its target.

    From the order of these lines it follows, whatever a policy asks and however its sensors fail:

    - **Range.** A target is from `lowest + margin` to `highest - margin`, the first one as well.
    - **Rate.** It moves by `reach` in a step at most: the last line brings a target nearer to the
      one before, which was within its limits.

    And as long as all that is asked and read is finite:

    - **Torque.** A target that is within `reach` of the reading stays so, while the reading moves
      by `reach` a step at most and is within `reach` of the limits: at rest the joint asks its
      motor for no more torque than it has. For the target before is then within twice `reach` of
      the reading, and the two intervals meet. A robot that starts, or a reading that jumps, further
      away is met by `reach` a step.
    - **Lean.** Where the trunk leans by more than `lean`, a joint is sent to where it is, or as
      near to it as limits allow, so that its motor damps it and does nothing else.

    Attributes:
        stiffness: Stiffness that torques at rest are computed with (N·m/rad).
        margin: Distance of targets from the ends of a joint's range (rad); by default the greatest
            error of an encoder in training.
        lean: Angle of the trunk beyond which joints are only damped (°); by default that of a fall.
    """

    title: ClassVar[str] = "limits"

    stiffness: Annotated[float, Ge(0.01), Le(1000.0)]
    margin: Annotated[float, Ge(0.0), Le(0.2)] = 0.02
    lean: Annotated[float, Gt(0.0), Le(90.0)] = 60.0

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


@checked
class JointLaw(Settings):
    """Gains and limits of the joints that a policy was trained with and needs.

    Attributes:
        gains: Stiffness and damping (N·m/rad, N·m·s/rad); by default the robot's.
        limited: Whether joints follow the nearest target within their ranges, which the policy
            then observes as its previous action.
        limits: Limits that come last; the policy observes the limited action as its previous one.
    """

    title: ClassVar[str] = "joint_law"

    gains: Gains | None = None
    limited: bool = False
    limits: TargetLimits | None = None

    def __post_init__(self) -> None:
        # What limits leave lies within the joints' ranges, but for rounding.
        object.__setattr__(self, "limited", self.limited or self.limits is not None)

    def gains_of(self, robot: Robot) -> tuple[float, float]:
        """Returns stiffness and damping of a robot's joints (N·m/rad, N·m·s/rad)."""
        return self.gains or (robot.stiffness, robot.damping)

    def torque(self, robot: Robot, *, action: Array, position: Array, velocity: Array) -> Array:
        """Returns the joints' torques (..., 12; N·m) as they follow an action (..., 12)."""
        return robot.joint_torque(
            target=robot.joint_targets(action, limited=self.limited),
            position=position,
            velocity=velocity,
            gains=self.gains_of(robot),
        )

    def over(self, other: "JointLaw") -> "JointLaw":
        """Returns this law with another's gains where it has none; either may limit targets."""
        limits = self.limits or other.limits
        return JointLaw(self.gains or other.gains, self.limited or other.limited, limits)

    def with_limits(self, robot: Robot) -> "JointLaw":
        """Returns this law with limits that count torques by its own stiffness."""
        stiffness, _ = self.gains_of(robot)
        limits = TargetLimits(stiffness)
        limits.check(robot)
        return replace(self, limits=limits)

    def check(self, robot: Robot) -> None:
        """Refuses limits that let a joint at rest ask its motor for more torque than it has."""
        stiffness, _ = self.gains_of(robot)
        if self.limits is not None and self.limits.stiffness < stiffness:
            raise InputError(
                f"limits: torque is divided by {self.limits.stiffness:g}, and the joints' "
                f"stiffness is {stiffness:g} N·m/rad, so that a joint at rest could ask its motor "
                f"for more than it has; divide by {stiffness:g} or more"
            )

    def to_plain(self) -> dict[str, Any]:
        """Returns what differs from the robot's own law, as values that JSON can hold."""
        gains = {} if self.gains is None else {"gains": list(self.gains)}
        limits = {} if self.limits is None else {"limits": asdict(self.limits)}
        return gains | ({"limited": True} if self.limited else {}) | limits


OWN_LAW = JointLaw()
"""The robot's own gains, and targets wherever they are."""
