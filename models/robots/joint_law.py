"""How joints follow a policy's targets: with which gains, and which of its targets."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Ge, Gt, Le

from glassgait.models.arrays import Array
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Settings

Stiffness = Annotated[float, Gt(0.0), Le(1000.0)]
Damping = Annotated[float, Ge(0.0), Le(100.0)]
Gains = tuple[Stiffness, Damping]
"""Gains of the joints' position and velocity control (N·m/rad, N·m·s/rad)."""


@dataclass(frozen=True)
class JointLaw(Settings):
    """The law by which a policy's joints learned to follow targets, and are to be driven.

    With other gains it is another robot that the policy moves.

    Attributes:
        gains: Stiffness and damping (N·m/rad, N·m·s/rad); by default the robot's.
        limited: Whether joints follow targets within their ranges alone: where a policy asks for
            more, the nearest target there. It is shown its previous action as it asked for it all
            the same.
    """

    title: ClassVar[str] = "joint_law"

    gains: Gains | None = None
    limited: bool = False

    def gains_of(self, robot: Robot) -> tuple[float, float]:
        """Returns stiffness and damping of a robot's joints (N·m/rad, N·m·s/rad)."""
        return self.gains or (robot.stiffness, robot.damping)

    def torque(self, robot: Robot, *, action: Array, position: Array, velocity: Array) -> Array:
        """Returns the joints' torques (..., 12; N·m) as an action (..., 12) is followed.

        Args:
            robot: The robot.
            action: The action.
            position: Joint positions (..., 12; rad).
            velocity: Joint velocities (..., 12; rad/s).
        """
        return robot.joint_torque(
            target=robot.joint_targets(action, limited=self.limited),
            position=position,
            velocity=velocity,
            gains=self.gains_of(robot),
        )

    def over(self, other: "JointLaw") -> "JointLaw":
        """Returns this law with another's gains where it has none; either may limit targets."""
        return JointLaw(self.gains or other.gains, self.limited or other.limited)

    def to_plain(self) -> dict[str, Any]:
        """Returns what differs from the robot's own law, as values that JSON can hold."""
        gains = {} if self.gains is None else {"gains": list(self.gains)}
        return gains | ({"limited": True} if self.limited else {})


OWN_LAW = JointLaw()
"""The robot's own gains, and targets wherever they are."""
