"""A robot as data, laid out as in `quadruped`, and the law by which its joints follow targets."""

import math
from dataclasses import asdict, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError
from glassgait.models.robots.quadruped import JOINTS, LEGS
from glassgait.models.settings import DISTINCT, IN_ORDER, Settings, checked

DEFAULT_ROBOT = "a1"  # name of the robot that is meant where none is named
ROBOT_DIRECTORY = Path(__file__).resolve().parent  # folders of the robots that ship, by name

RobotName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Length = Annotated[float, Ge(1e-3), Le(10.0)]
Angle = Annotated[float, Ge(-10.0), Le(10.0)]
Effort = Annotated[float, Ge(0.01), Le(10_000.0)]
Velocity = Annotated[float, Ge(0.01), Le(1000.0)]
Box = tuple[Length, Length, Length]


@checked
class Robot(Settings):
    """A quadruped: lengths, limits, gains and the joint-level law that drives it.

    `library.load_robot` makes robots: sizes, mass and limits are from the URDF, the rest is from
    `robot.yaml`. Robots are equal only if they are the same object.
    """

    title: ClassVar[str] = "robot"

    name: RobotName
    full_name: Annotated[str, MinLen(1), MaxLen(80)]  # Name for people.
    description: Annotated[str, MinLen(1), MaxLen(200)]  # File of its URDF, beside its own.
    # Joint angles of the default stance by leg: hip, thigh, calf (rad).
    stance: dict[str, tuple[Angle, Angle, Angle]]
    # Gains of the joints' position and velocity control (N·m/rad, N·m·s/rad).
    stiffness: Annotated[float, Ge(0.01), Le(1000.0)]
    damping: Annotated[float, Ge(0.001), Le(100.0)]
    # What an action of 1 adds to a joint's target (rad).
    action_scale: Annotated[float, Ge(0.001), Le(10.0)]
    mass: Annotated[float, Ge(0.1), Le(1000.0)]  # kg
    # Distance of a hip joint from the trunk's centre, along x and along y (m).
    hip_offset: tuple[Length, Length]
    thigh_offset: Length  # Distance of a thigh joint outward from its hip joint (m).
    thigh_length: Length  # From the thigh joint to the knee (m).
    calf_length: Length  # From the knee to the foot's centre (m).
    foot_radius: Length  # Radius of the feet, which are spheres (m).
    trunk_box: Box  # Sizes of the trunk's collision box (m).
    thigh_box: Box  # Sizes of a thigh's; the first is along the limb (m).
    calf_box: Box  # Sizes of a calf's (m).
    # Least and greatest angle of each joint (rad).
    position_limits: tuple[Annotated[tuple[Angle, Angle], IN_ORDER], ...]
    effort_limits: tuple[Effort, ...]  # Greatest torque of each joint (N·m).
    velocity_limits: tuple[Velocity, ...]  # Greatest velocity of each joint (rad/s).
    urdf: str = field(repr=False)  # What Drake and MuJoCo read.
    # Legs in the order in which the vendor's controller numbers their motors.
    motor_order: Annotated[tuple[str, ...], DISTINCT] = LEGS
    path: str = ""  # File it was loaded from.

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
        """Command-line option that selects this robot; empty for the default robot."""
        return "" if self.name == DEFAULT_ROBOT else f" --robot {self.source}"

    @cached_property
    def is_shipped(self) -> bool:
        """True if the robot ships with the project."""
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
        self, *, target: Array, position: Array, velocity: Array, gains: tuple[float, float]
    ) -> Array:
        """Evaluates the joints' PD law, limited to the motors' effort, at one instant.

        Targets and positions are in rad, velocities in rad/s (..., 12 each); gains are stiffness
        and damping (N·m/rad, N·m·s/rad).
        """
        stiffness, damping = gains
        torque = stiffness * (target - position) - damping * velocity
        return clip(torque, -self.effort, self.effort)


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


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
    """

    title: ClassVar[str] = "limits"

    # Stiffness that torques at rest are computed with (N·m/rad).
    stiffness: Annotated[float, Ge(0.01), Le(1000.0)]
    # Distance of targets from the ends of a joint's range (rad); by default the greatest error of
    # an encoder in training.
    margin: Annotated[float, Ge(0.0), Le(0.2)] = 0.02
    # Angle of the trunk beyond which joints are only damped (°); by default that of a fall.
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

    def ends(self, robot: Robot) -> tuple[Array, Array]:
        """Returns the least and the greatest actions (12 each)."""
        stance, scale = robot.default_stance, robot.action_scale
        least = (robot.lower_limits + self.margin - stance) / scale
        return least, (robot.upper_limits - self.margin - stance) / scale

    def applied(
        self, robot: Robot, action: Array, *, before: Array, position: Array, gravity: Array
    ) -> Array:
        """Returns what the limits leave of actions (..., 12); those within them keep every digit.

        `before` are the actions of the step before (..., 12), within the limits; measured are joint
        positions (..., 12; rad) and gravity's direction in the trunk's frame (..., 3).
        """
        here = (position - robot.default_stance) / robot.action_scale
        # The greatest distance of targets from joints and from targets before.
        reach = robot.effort / self.stiffness / robot.action_scale
        least, greatest = self.ends(robot)
        is_upright = gravity[..., 2:] < self.upright
        limited = np.where(is_upright, action, here)
        limited = clip(limited, here - reach, here + reach)
        limited = clip(limited, before - reach, before + reach)
        limited = clip(limited, least, greatest)
        finite = np.isfinite(action + position).all(axis=-1, keepdims=True)
        return np.where(finite, limited, before)


@checked
class JointLaw(Settings):
    """Gains and limits of the joints that a policy was trained with and needs."""

    title: ClassVar[str] = "joint_law"

    gains: Gains | None = None  # Stiffness and damping (N·m/rad, N·m·s/rad); by default the robot's
    # Whether joints follow the nearest target within their ranges, which the policy then observes
    # as its previous action.
    limited: bool = False
    # Limits that come last; the policy observes the limited action as its previous one.
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

    def merged(self, other: "JointLaw") -> "JointLaw":
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


DEFAULT_LAW = JointLaw()  # the robot's own gains, and targets wherever they are
