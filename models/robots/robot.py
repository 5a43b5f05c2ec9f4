"""A robot as data, laid out as in `quadruped`, and the control law of its joints."""

import math
from dataclasses import asdict, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from annotated_types import Ge, Gt, Le, Len, MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError
from glassgait.models.robots.quadruped import JOINTS, LEGS
from glassgait.models.settings import DISTINCT, IN_ORDER, Settings, checked

DEFAULT_ROBOT = "a1"
ROBOT_DIRECTORY = Path(__file__).resolve().parent  # has a folder for each shipped robot

RobotName = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Length = Annotated[float, Ge(1e-3), Le(10.0)]
Angle = Annotated[float, Ge(-10.0), Le(10.0)]
Effort = Annotated[float, Ge(0.01), Le(10_000.0)]
Velocity = Annotated[float, Ge(0.01), Le(1000.0)]
Box = tuple[Length, Length, Length]
OF_EACH_JOINT = Len(len(JOINTS), len(JOINTS))


@checked
class Robot(Settings):
    """A quadruped: lengths, limits, gains and the joint-level law that drives it.

    `library.load_robot` takes sizes, mass and limits from the URDF and the rest from `robot.yaml`.
    Robots are equal only if they are the same object.
    """

    title: ClassVar[str] = "robot"

    name: RobotName
    full_name: Annotated[str, MinLen(1), MaxLen(80)]  # Name for people.
    description: Annotated[str, MinLen(1), MaxLen(200)]  # URDF file, in the folder of `path`.
    # Joint angles of the default stance by leg: hip, thigh, calf (rad).
    stance: dict[str, tuple[Angle, Angle, Angle]]
    # Gains of the joints' position and velocity control (N·m/rad, N·m·s/rad).
    stiffness: Annotated[float, Ge(0.01), Le(1000.0)]
    damping: Annotated[float, Ge(0.001), Le(100.0)]
    # Change of a joint's target for an action of 1 (rad).
    action_scale: Annotated[float, Ge(0.001), Le(10.0)]
    mass: Annotated[float, Ge(0.1), Le(1000.0)]  # kg
    # Distance of a hip joint from the trunk's centre, along x and along y (m).
    hip_offset: tuple[Length, Length]
    thigh_offset: Length  # Distance of a thigh joint outward from its hip joint (m).
    thigh_length: Length  # From the thigh joint to the knee (m).
    calf_length: Length  # From the knee to the foot's centre (m).
    foot_radius: Length  # Radius of the feet, which are spheres (m).
    trunk_box: Box  # Sizes of the trunk's collision box (m).
    thigh_box: Box  # Sizes of a thigh's box (m); the first is along the limb.
    calf_box: Box  # Sizes of a calf's box (m); the first is along the limb.
    # Least and greatest angle of each joint (rad).
    position_limits: tuple[Annotated[tuple[Angle, Angle], IN_ORDER], ...]
    effort_limits: tuple[Effort, ...]  # Greatest torque of each joint (N·m).
    velocity_limits: tuple[Velocity, ...]  # Greatest velocity of each joint (rad/s).
    urdf: str = field(repr=False)  # Text of the URDF that Drake and MuJoCo read.
    # Legs in the order of the vendor's motor numbers.
    motor_order: Annotated[tuple[str, ...], DISTINCT] = LEGS
    path: str = ""  # The `robot.yaml` that it was loaded from.

    __eq__ = object.__eq__
    __hash__ = object.__hash__

    def __post_init__(self) -> None:
        for key, legs in (("stance", self.stance), ("motor_order", self.motor_order)):
            if sorted(legs) != sorted(LEGS):
                raise InputError(f"{key} has the legs {', '.join(legs)}; name {', '.join(LEGS)}")
        for joint, angle, low, high in zip(
            JOINTS, self.default_stance, self.lower_limits, self.upper_limits, strict=True
        ):
            if not low <= angle <= high:
                raise InputError(
                    f"stance has {joint} at {angle:g} rad; give an angle from {low:g} to {high:g}"
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
        """Path of the original URDF."""
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
        """Positions of the hip joints in the trunk's frame (4, 3; m)."""
        ahead = np.array([1.0 if leg[0] == "F" else -1.0 for leg in LEGS])
        x, y = self.hip_offset
        return _fixed(np.stack([x * ahead, y * self.side, np.zeros(len(LEGS))], axis=-1))

    def joint_targets(self, action: Array, *, limited: bool = False) -> Array:
        """Converts actions (..., 12) to joint position targets (..., 12; rad).

        If `limited`, clips targets to the joints' ranges. NaN stays NaN.
        """
        targets = self.default_stance + self.action_scale * action
        if not limited:
            return targets
        return clip(targets, self.lower_limits, self.upper_limits)

    def limited_action(self, action: Array) -> Array:
        """Clips actions (..., 12) so that their targets are within the joints' ranges."""
        least, greatest = self._action_limits
        return clip(action, least, greatest)

    @cached_property
    def _action_limits(self) -> tuple[Array, Array]:
        limits = (self.lower_limits, self.upper_limits)
        least, greatest = ((angles - self.default_stance) / self.action_scale for angles in limits)
        return _fixed(least), _fixed(greatest)


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array


JointStiffness = Annotated[float, Gt(0.0), Le(1000.0)]
JointDamping = Annotated[float, Ge(0.0), Le(100.0)]
Stiffness = JointStiffness | Annotated[tuple[JointStiffness, ...], OF_EACH_JOINT]
Damping = JointDamping | Annotated[tuple[JointDamping, ...], OF_EACH_JOINT]
Gains = tuple[Stiffness, Damping]
"""Gains of the joints' position and velocity control (N·m/rad, N·m·s/rad), each one number for all
joints or one for each (12)."""


@checked
class TargetLimits(Settings):
    """Limits that are applied last to joint targets, and hold for any policy.

    For each joint, as formula files write them:

        reach = torque/stiffness
        wanted = asked if g.z < -cos(lean) else q
        weak = clip(wanted, q - reach, q + reach)
        slow = clip(weak, before - reach, before + reach)
        target = clip(slow, lowest + margin, highest - margin)

    `asked` is the policy's target, `before` the target of the previous step and `q` the measured
    angle, all in rad. The first target is the default stance. If an angle or a policy's target is
    not finite, all joints keep their targets.

    The order of these lines guarantees, for any policy and any failure of its sensors:

    - **Range.** Each target, also the first one, is from `lowest + margin` to `highest - margin`.
    - **Rate.** It moves by at most `reach` in a step: the last line can only bring it nearer to the
      previous target, which was within these ends.

    As long as the policy's targets and the readings are finite:

    - **Torque.** Suppose that a target is within `reach` of the reading, and that the reading moves
      by at most `reach` in a step and is at most `reach` beyond the ends. Then the old target is
      within twice `reach` of the reading, so the two intervals meet, and the next target is also
      within `reach` of the reading: a joint at rest never demands more torque than its motor has.
      From further away, as after a jump of the reading, the target approaches by `reach` a step.
    - **Lean.** If the trunk leans by more than `lean`, the target is the measured angle, or as near
      to it as the limits allow, so that the motor only damps the joint.
    """

    title: ClassVar[str] = "limits"

    # Stiffness from which the torque at rest is computed (N·m/rad).
    stiffness: Annotated[float, Ge(0.01), Le(1000.0)]
    # Distance of targets from the ends of a joint's range (rad); the default is the greatest error
    # of an encoder in training.
    margin: Annotated[float, Ge(0.0), Le(0.2)] = 0.02
    # Angle of the trunk beyond which joints are only damped (°); the default is that of a fall.
    lean: Annotated[float, Gt(0.0), Le(90.0)] = 60.0

    @cached_property
    def upright(self) -> float:
        """Value of `g.z` (see above) below which the policy acts."""
        # Rounded, so that the exported C has -0.5 for a lean of 60°.
        return -round(math.cos(math.radians(self.lean)), 12)

    def check(self, robot: Robot) -> None:
        """Refuses a robot whose default stance, where robots start, is outside the limits."""
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
        """Limits actions (..., 12); those within the limits keep every digit.

        `before` holds the previous actions (..., 12), which are within the limits. Joint positions
        (..., 12; rad) and gravity's direction (..., 3; trunk frame) are measured.
        """
        here = (position - robot.default_stance) / robot.action_scale
        # The greatest distance of targets from the joints and from the previous targets.
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

    gains: Gains | None = None  # Stiffness and damping; by default the robot's
    # Whether targets are clipped to the joints' ranges; the policy then observes the clipped action
    # as its previous action.
    limited: bool = False
    # Limits that are applied last; the policy observes the limited action as its previous action.
    limits: TargetLimits | None = None

    def __post_init__(self) -> None:
        # Limited targets are within the joints' ranges, except for rounding.
        object.__setattr__(self, "limited", self.limited or self.limits is not None)

    def gains_of(self, robot: Robot) -> Gains:
        """Returns stiffness and damping of a robot's joints (N·m/rad, N·m·s/rad)."""
        return self.gains or (robot.stiffness, robot.damping)

    def worst_gains(self, robot: Robot) -> tuple[float, float]:
        """Returns the greatest stiffness and the least damping of a robot's joints."""
        stiffness, damping = self.gains_of(robot)
        return float(np.max(stiffness)), float(np.min(damping))

    def torque(self, robot: Robot, *, action: Array, position: Array, velocity: Array) -> Array:
        """Evaluates the PD law of joints that follow an action, limited to the motors' effort.

        Actions, positions (rad), velocities (rad/s) and torques (N·m) are (..., 12).
        """
        stiffness, damping = map(np.asarray, self.gains_of(robot))
        target = robot.joint_targets(action, limited=self.limited)
        torque = stiffness * (target - position) - damping * velocity
        return clip(torque, -robot.effort, robot.effort)

    def merged(self, other: "JointLaw") -> "JointLaw":
        """Completes the law with the gains and limits of another one."""
        limits = self.limits or other.limits
        return JointLaw(self.gains or other.gains, self.limited or other.limited, limits)

    def with_limits(self, robot: Robot) -> "JointLaw":
        """Returns this law with target limits for its stiffness."""
        limits = TargetLimits(self.worst_gains(robot)[0])
        limits.check(robot)
        return replace(self, limits=limits)

    def check(self, robot: Robot) -> None:
        """Refuses limits with which a joint at rest could demand more than its motor's torque."""
        stiffness, _ = self.worst_gains(robot)
        if self.limits is not None and self.limits.stiffness < stiffness:
            raise InputError(
                f"limits: torque is divided by {self.limits.stiffness:g}, less than the joints' "
                f"stiffness; divide by {stiffness:g} N·m/rad or more"
            )

    def to_plain(self) -> dict[str, Any]:
        """Returns the differences from `DEFAULT_LAW` as values for JSON."""
        gains = {} if self.gains is None else {"gains": list(self.gains)}
        limits = {} if self.limits is None else {"limits": asdict(self.limits)}
        return gains | ({"limited": True} if self.limited else {}) | limits


DEFAULT_LAW = JointLaw()  # the robot's gains, and targets without limits
