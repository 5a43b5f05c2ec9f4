"""The law by which joints follow a policy's targets."""

from dataclasses import asdict, replace
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.settings import Settings, checked

Stiffness = Annotated[float, Gt(0.0), Le(1000.0)]
Damping = Annotated[float, Ge(0.0), Le(100.0)]
Gains = tuple[Stiffness, Damping]
"""Gains of the joints' position and velocity control (N·m/rad, N·m·s/rad)."""


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
