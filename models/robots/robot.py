"""A robot as data: what differs from one quadruped to another, as `quadruped` lays one out."""

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt, Le, MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError, shown
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS
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

    `library.load_robot` makes robots; equal is only what is the same object.

    Attributes:
        name: Its name, which files of policies hold.
        full_name: What people call it.
        description: File of its URDF, beside its own.
        mass: Mass of the robot (kg).
        hip_offset: Distance of a hip joint from the trunk's centre, along x and along y (m).
        thigh_offset: Distance of a thigh joint outward from its hip joint (m).
        thigh_length: From the thigh joint to the knee (m).
        calf_length: From the knee to the foot's centre (m).
        foot_radius: Radius of the feet, which are spheres (m).
        trunk_box: Sizes of the trunk's collision box (m).
        thigh_box: Sizes of a thigh's, of which the first is along the limb (m).
        calf_box: Sizes of a calf's (m).
        position_limits: Least and greatest angle (rad) by kind of joint, such as thigh, or by
            joint, such as RL_thigh, which stands above its kind.
        effort_limits: Greatest torque (N·m), in the same way.
        velocity_limits: Greatest velocity (rad/s), in the same way.
        stance: Joint angles of the default stance by leg: hip, thigh, calf (rad).
        stiffness: Gain of the joints' position control (N·m/rad).
        damping: Gain of their velocity control (N·m·s/rad).
        action_scale: What an action of 1 adds to a joint's target (rad).
        motor_order: Legs in the order in which the vendor's controller numbers their motors.
        path: Where it was loaded from.
    """

    name: RobotName
    full_name: Annotated[str, MinLen(1), MaxLen(80)]
    description: Annotated[str, MinLen(1), MaxLen(200)]
    mass: Annotated[float, Gt(0.0), Le(1000.0)]
    hip_offset: tuple[Length, Length]
    thigh_offset: Length
    thigh_length: Length
    calf_length: Length
    foot_radius: Length
    trunk_box: Box
    thigh_box: Box
    calf_box: Box
    position_limits: dict[str, Range]
    effort_limits: dict[str, Positive]
    velocity_limits: dict[str, Positive]
    stance: dict[str, Triple]
    stiffness: Positive
    damping: Positive
    action_scale: Positive
    motor_order: Annotated[tuple[str, ...], DISTINCT] = LEGS
    path: str = ""

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        for key in ("position_limits", "effort_limits", "velocity_limits"):
            _refuse_other_keys(key, getattr(self, key), {*LEG_JOINTS, *JOINTS})
            self._of_joints(key)
        for key, legs in (("stance", self.stance), ("motor_order", self.motor_order)):
            if sorted(legs) != sorted(LEGS):
                raise InputError(f"{key} is of {', '.join(legs)}; name {', '.join(LEGS)}")
        for joint, angle, low, high in zip(
            JOINTS, self.default_stance, self.lower_limits, self.upper_limits, strict=True
        ):
            if not low <= angle <= high:
                raise InputError(
                    f"stance has {joint} at {angle:g} rad, outside of position_limits, {low:g} to "
                    f"{high:g}; give an angle in this range"
                )

    def refused_as(self) -> str:
        return "robot"

    @cached_property
    def source(self) -> str:
        """What `load_robot` finds it by: the name of a robot that ships, or the path of a file."""
        return self.name if self.is_shipped else self.path

    @property
    def option(self) -> str:
        """What a command line ends in to be about it: nothing, where it is the default robot."""
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
        return _fixed([low for low, _ in self._of_joints("position_limits")])

    @cached_property
    def upper_limits(self) -> Array:
        """Greatest angles of the joints (12; rad)."""
        return _fixed([high for _, high in self._of_joints("position_limits")])

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
        return _fixed(self._of_joints("effort_limits"))

    @cached_property
    def velocity(self) -> Array:
        """Greatest velocities of the joints (12; rad/s)."""
        return _fixed(self._of_joints("velocity_limits"))

    @cached_property
    def default_stance(self) -> Array:
        """Joint angles of the default stance (12; rad)."""
        return _fixed([angle for leg in LEGS for angle in self.stance[leg]])

    def check_lowered(self, pose: Array, what: str) -> None:
        """Refuses joint angles that this robot cannot be lowered by.

        Args:
            pose: Joint angles (12; rad) of legs whose knees point backward.
            what: What they are for.

        Raises:
            InputError: if a knee points forward in the stance, or an angle is beyond its range.
        """
        for joint, angle, own, low, high in zip(
            JOINTS, pose, self.default_stance, self.lower_limits, self.upper_limits, strict=True
        ):
            bends = joint.endswith(LEG_JOINTS[-1]) and own * angle < 0.0
            if bends or not low <= angle <= high:
                raise InputError(
                    f"{self.path}: {what} would send {joint} to {angle:g} rad, with its knee the "
                    f"other way or beyond {low:g} to {high:g} rad; it is made for robots whose "
                    "knees point backward and fold that far"
                )

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

        Args:
            action: Actions (..., 12).
            limited: Whether to return what joints follow that are kept within their ranges: the
                nearest targets there. NaN stays NaN.
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

        Returns:
            Torques (..., 12; N·m).
        """
        stiffness, damping = gains
        torque = stiffness * (target - position) - damping * velocity
        return clip(torque, -self.effort, self.effort)

    def _of_joints(self, key: str) -> list[Any]:
        """Returns what a key gives each joint, by itself or by its kind."""
        given: Mapping[str, Any] = getattr(self, key)
        for joint in JOINTS:
            kind = joint.partition("_")[2]
            if joint not in given and kind not in given:
                raise InputError(f"{key} lacks {kind}; add it, or {joint}")
        return [given.get(joint, given.get(joint.partition("_")[2])) for joint in JOINTS]


def _refuse_other_keys(key: str, given: Mapping[str, Any], known: set[str]) -> None:
    if unknown := sorted(set(given) - known):
        raise InputError(
            f"{key} has the key {shown(unknown[0])}; name kinds of joints, "
            f"{', '.join(LEG_JOINTS)}, or joints, such as RL_thigh"
        )


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
