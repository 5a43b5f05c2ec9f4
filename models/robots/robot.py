"""A robot as data, laid out as in `quadruped`."""

from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Gt, Le, MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError
from glassgait.models.robots.quadruped import JOINTS, LEGS
from glassgait.models.settings import DISTINCT, Positive, Range, Settings, checked

DEFAULT_ROBOT = "a1"
"""Name of the robot that is meant where none is named."""

ROBOT_DIRECTORY = Path(__file__).parent
"""Where the folders of robots are that ship, by their names."""

NAME = r"^[a-z][a-z0-9_]{0,39}$"
"""What a robot may be called."""

RobotName = Annotated[str, StringConstraints(pattern=NAME)]
Length = Annotated[float, Gt(0.0), Le(10.0)]
Box = tuple[Length, Length, Length]
Triple = tuple[float, float, float]


@checked
class Robot(Settings):
    """A quadruped: lengths, limits, gains and the joint-level law that drives it.

    `library.load_robot` makes robots: sizes, mass and limits are from the URDF, the rest is from
    `robot.yaml`. Robots are equal only if they are the same object.

    Attributes:
        name: Its name, which files of policies hold.
        full_name: Name for people.
        description: File of its URDF, beside its own.
        stance: Joint angles of the default stance by leg: hip, thigh, calf (rad).
        stiffness: Gain of the joints' position control (N·m/rad).
        damping: Gain of their velocity control (N·m·s/rad).
        action_scale: What an action of 1 adds to a joint's target (rad).
        mass: Mass of the robot (kg).
        hip_offset: Distance of a hip joint from the trunk's centre, along x and along y (m).
        thigh_offset: Distance of a thigh joint outward from its hip joint (m).
        thigh_length: From the thigh joint to the knee (m).
        calf_length: From the knee to the foot's centre (m).
        foot_radius: Radius of the feet, which are spheres (m).
        trunk_box: Sizes of the trunk's collision box (m).
        thigh_box: Sizes of a thigh's; the first is along the limb (m).
        calf_box: Sizes of a calf's (m).
        position_limits: Least and greatest angle of each joint (rad).
        effort_limits: Greatest torque of each joint (N·m).
        velocity_limits: Greatest velocity of each joint (rad/s).
        motor_order: Legs in the order in which the vendor's controller numbers their motors.
        path: File it was loaded from.
    """

    title: ClassVar[str] = "robot"

    name: RobotName
    full_name: Annotated[str, MinLen(1), MaxLen(80)]
    description: Annotated[str, MinLen(1), MaxLen(200)]
    stance: dict[str, Triple]
    stiffness: Positive
    damping: Positive
    action_scale: Positive
    mass: Annotated[float, Gt(0.0), Le(1000.0)]
    hip_offset: tuple[Length, Length]
    thigh_offset: Length
    thigh_length: Length
    calf_length: Length
    foot_radius: Length
    trunk_box: Box
    thigh_box: Box
    calf_box: Box
    position_limits: tuple[Range, ...]
    effort_limits: tuple[Positive, ...]
    velocity_limits: tuple[Positive, ...]
    motor_order: Annotated[tuple[str, ...], DISTINCT] = LEGS
    path: str = ""

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        for key, legs in (("stance", self.stance), ("motor_order", self.motor_order)):
            if sorted(legs) != sorted(LEGS):
                raise InputError(f"{key} is of {', '.join(legs)}; name {', '.join(LEGS)}")
        for joint, angle, low, high in zip(
            JOINTS, self.default_stance, self.lower_limits, self.upper_limits, strict=True
        ):
            if not low <= angle <= high:
                raise InputError(
                    f"stance has {joint} at {angle:g} rad, outside of its range, {low:g} to "
                    f"{high:g}; give an angle in this range"
                )

    @cached_property
    def source(self) -> str:
        """Name of a robot that ships, or path of its file, as `load_robot` takes it."""
        return self.name if self.is_shipped else self.path

    @property
    def option(self) -> str:
        """Option of a command line that names this robot; empty for the default robot."""
        return "" if self.name == DEFAULT_ROBOT else f" --robot {self.source}"

    @cached_property
    def is_shipped(self) -> bool:
        """Whether it ships with the project."""
        return Path(self.path).parent == ROBOT_DIRECTORY / self.name

    @cached_property
    def urdf_path(self) -> Path:
        """Path of its description."""
        return Path(self.path).parent / self.description

    @cached_property
    def lower_limits(self) -> Array:
        """Least angles of the joints (12; rad)."""
        return _fixed([low for low, _ in self.position_limits])

    @cached_property
    def upper_limits(self) -> Array:
        """Greatest angles of the joints (12; rad)."""
        return _fixed([high for _, high in self.position_limits])

    @cached_property
    def middle(self) -> Array:
        """Middles of the joints' ranges (12; rad)."""
        return _fixed(0.5 * (self.upper_limits + self.lower_limits))

    @cached_property
    def half_range(self) -> Array:
        """Half of the joints' ranges (12; rad)."""
        return _fixed(0.5 * (self.upper_limits - self.lower_limits))

    @cached_property
    def effort(self) -> Array:
        """Greatest torques of the joints (12; N·m)."""
        return _fixed(self.effort_limits)

    @cached_property
    def velocity(self) -> Array:
        """Greatest velocities of the joints (12; rad/s)."""
        return _fixed(self.velocity_limits)

    @cached_property
    def default_stance(self) -> Array:
        """Joint angles of the default stance (12; rad)."""
        return _fixed([angle for leg in LEGS for angle in self.stance[leg]])

    @cached_property
    def side(self) -> Array:
        """1 for the left legs and -1 for the right ones (4)."""
        return _fixed([1.0 if leg[1] == "L" else -1.0 for leg in LEGS])

    @cached_property
    def thigh_offsets(self) -> Array:
        """Distances of the thigh joints from their hip joints, to the left (4; m)."""
        return _fixed(self.side * self.thigh_offset)

    @cached_property
    def hip_origin(self) -> Array:
        """Places of the hip joints in the trunk's frame (4, 3; m)."""
        ahead = np.array([1.0 if leg[0] == "F" else -1.0 for leg in LEGS])
        x, y = self.hip_offset
        return _fixed(np.stack([x * ahead, y * self.side, np.zeros(len(LEGS))], axis=-1))

    def joint_targets(self, action: Array, *, limited: bool = False) -> Array:
        """Returns the joint position targets (..., 12; rad) that an action (..., 12) asks for.

        If `limited`, they are the nearest within the joints' ranges. NaN stays NaN.
        """
        targets = self.default_stance + self.action_scale * action
        if not limited:
            return targets
        return clip(targets, self.lower_limits, self.upper_limits)

    def limited_action(self, action: Array) -> Array:
        """Returns the action (..., 12) whose targets are the nearest within the joints' ranges."""
        least, greatest = self._action_limits
        return clip(action, least, greatest)

    @cached_property
    def _action_limits(self) -> tuple[Array, Array]:
        limits = (self.lower_limits, self.upper_limits)
        least, greatest = ((own - self.default_stance) / self.action_scale for own in limits)
        return _fixed(least), _fixed(greatest)

    def joint_torque(
        self,
        *,
        target: Array,
        position: Array,
        velocity: Array,
        gains: tuple[float, float],
    ) -> Array:
        """Evaluates the joints' PD law, limited to the motors' effort.

        The plant integrates the same law implicitly; this is its value at one instant.

        Args:
            target: Joint position targets (..., 12; rad).
            position: Joint positions (..., 12; rad).
            velocity: Joint velocities (..., 12; rad/s).
            gains: Stiffness and damping (N·m/rad, N·m·s/rad).
        """
        stiffness, damping = gains
        torque = stiffness * (target - position) - damping * velocity
        return clip(torque, -self.effort, self.effort)


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
