"""Robots as data: `<name>/robot.yaml` and a description in URDF, checked against each other.

A robot here is a quadruped as `quadruped` lays one out; what differs from one to another stands in
its file. Adding a robot takes the two files and no code.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.arrays import Array, clip
from glassgait.models.errors import InputError, shown
from glassgait.models.files import read_text, read_yaml
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS, LEGS
from glassgait.models.settings import DISTINCT, Positive, Range, Settings

DEFAULT_ROBOT = "a1"
"""Name of the robot that is meant where none is named."""

ROBOT_DIRECTORY = Path(__file__).parent
ROBOT_FILE = "robot.yaml"

LARGEST_DESCRIPTION = 10_000_000
"""Greatest size of a URDF (bytes)."""

TOLERANCE = 1e-6
"""Greatest difference of a number in both files; a URDF holds some six digits."""

MASS_TOLERANCE = 1e-3
"""Greatest difference of the robot's mass (kg)."""

PHYSICAL = 1e-6
"""By how much two principal moments may be less than the third, over it: files round them."""

AXES = {"hip": (1.0, 0.0, 0.0), "thigh": (0.0, 1.0, 0.0), "calf": (0.0, 1.0, 0.0)}
"""Axis of each kind of joint."""

NAME = r"^[a-z][a-z0-9_]{0,39}$"
"""What a robot may be called."""

RobotName = Annotated[str, StringConstraints(pattern=NAME)]
Length = Annotated[float, Gt(0.0), Le(10.0)]
Box = tuple[Length, Length, Length]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Inertial(Settings):
    """Mass (kg), centre of mass (m) and inertia about it (kg·m²) of a body, in the body's axes."""

    title: ClassVar[str] = "inertia"

    mass: Positive
    center: Triple
    ixx: Positive
    ixy: float
    ixz: float
    iyy: Positive
    iyz: float
    izz: Positive

    @property
    def matrix(self) -> Array:
        """The inertia about the centre of mass (3, 3)."""
        return np.array(
            [
                [self.ixx, self.ixy, self.ixz],
                [self.ixy, self.iyy, self.iyz],
                [self.ixz, self.iyz, self.izz],
            ]
        )


@dataclass(frozen=True)
class FootForce(Settings):
    """How the feet's force sensors are read, which count in units of their own.

    Attributes:
        release: A foot that touches does so until its sensor counts no more than this.
        touch: One that does not touch does from this count on.
        per_newton: Counts of a newton, by which a simulated robot's sensors count.
    """

    title: ClassVar[str] = "foot_force"

    release: Annotated[float, Ge(0.0), Le(30000.0)]
    touch: Annotated[float, Gt(0.0), Le(30000.0)]
    per_newton: Annotated[float, Gt(0.0), Le(1000.0)]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.release >= self.touch:
            raise InputError(
                f"foot_force: release is {self.release:g}; give one below touch = {self.touch:g}"
            )


@dataclass(frozen=True, eq=False)
class Robot(Settings):
    """A quadruped: lengths, limits, gains and the joint-level law that drives it.

    `load_robot` makes robots; equal is only what is the same object.

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
        foot_force: How the feet's force sensors are read; only Unitree's messages have them.
        inertias: Inertias of the trunk and of the front left leg's hip, thigh, calf and, where the
            calf's is without it, foot; only `description` reads them.
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
    foot_force: FootForce | None = None
    inertias: dict[str, Inertial] = field(default_factory=dict)
    path: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("position_limits", "effort_limits", "velocity_limits"):
            _refuse_other_keys(key, getattr(self, key), {*LEG_JOINTS, *JOINTS})
            self._of_joints(key)
        for name, body in self.inertias.items():
            _refuse_of_no_body(name, body)
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

    def __reduce__(self) -> tuple[Any, ...]:
        # A copy, and what another process gets, is the one that the file stands for.
        return load_robot, (self.path,)

    @cached_property
    def source(self) -> str:
        """What `load_robot` finds it by: the name of a robot that ships, or the path of a file."""
        return self.name if self.name in robot_names() and self.is_shipped else self.path

    @property
    def option(self) -> str:
        """What a command line ends in to be about it: nothing, where it is the default robot."""
        return "" if self.name == DEFAULT_ROBOT else f" --robot {self.source}"

    @cached_property
    def is_shipped(self) -> bool:
        """Whether it ships with the project."""
        return Path(self.path).parent.parent == ROBOT_DIRECTORY

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


def robot_names() -> tuple[str, ...]:
    """Lists the robots that ship with the project, the default one first."""
    names = (path.parent.name for path in ROBOT_DIRECTORY.glob(f"*/{ROBOT_FILE}"))
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_ROBOT, name)))


def load_robot(robot: str | Path = DEFAULT_ROBOT) -> Robot:
    """Loads a robot by its name, or from a `robot.yaml` of one's own, once a process and edit.

    Args:
        robot: Name of a robot that ships, or path of a file that ends in .yaml.

    Raises:
        InputError: if there is no such robot, its file breaks a rule, or its description is of
            another robot; the message names the file, the key and the remedy.
    """
    path = Path(robot)
    if path.is_dir() and str(robot) not in robot_names():
        raise InputError(f"{path}: is a folder; give a robot's file in it, as {path / ROBOT_FILE}")
    if path.suffix not in (".yaml", ".yml"):
        if str(robot) not in robot_names():
            raise InputError(
                f"unknown robot {shown(str(robot))}; the robots are {', '.join(robot_names())}, or "
                "give the path of a robot's file ending in .yaml"
            )
        path = ROBOT_DIRECTORY / str(robot) / ROBOT_FILE
    path = path.resolve()
    return _load(path, path.stat().st_mtime_ns if path.exists() else 0)


def robot_of(path: Path, name: object, robot: Robot | None = None) -> Robot:
    """Returns the robot that a file is of.

    Args:
        path: The file.
        name: What its key "robot" holds; None where it has none, and is of the default robot.
        robot: The robot that it has to be of; by default any that ships.

    Raises:
        InputError: if it is of another robot, or of one that does not ship.
    """
    name = DEFAULT_ROBOT if name is None else name
    if robot is None:
        if name not in robot_names():
            raise InputError(
                f"{path}: key 'robot' is {shown(name)}, and no such robot ships; give its "
                "robot.yaml by --robot"
            )
        return load_robot(str(name))
    if name != robot.name:
        raise InputError(
            f"{path}: is of robot {shown(name)} (key 'robot'), not {robot.name!r}; give a file of "
            f"the {robot.name}, or --robot {name}"
        )
    return robot


def robot_folder(directory: Path, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns the part of a directory of files or runs that is of a robot, by its name."""
    return directory if robot == DEFAULT_ROBOT else directory / robot


@cache
def _load(path: Path, _edited: int) -> Robot:
    robot = read_robot(path)
    _Description(robot).compare()
    return robot


def read_robot(path: Path) -> Robot:
    """Reads a robot's file, whatever its description.

    Raises:
        InputError: if the file breaks a rule; the message names the file, the key and the remedy.
    """
    found = read_yaml(path)
    if not isinstance(found, dict):
        raise InputError(f"{path}: is not a mapping; write it as that of a robot that ships")
    if "path" in found:
        raise InputError(f"{path}: unknown key 'path'; remove it")
    robot = Robot.from_plain(found | {"path": str(path)}, str(path))
    if robot.name in robot_names() and not robot.is_shipped:
        raise InputError(
            f"{path}: key 'name' is {robot.name!r}, a robot that ships; give it another name"
        )
    return robot


class _Description:
    """A robot's URDF, compared with the robot's own file; each method refuses what differs."""

    def __init__(self, robot: Robot) -> None:
        """
        Raises:
            InputError: if the URDF cannot be read.
        """
        self.robot = robot
        try:
            self.root = ElementTree.fromstring(read_text(robot.urdf_path, LARGEST_DESCRIPTION))
        except ElementTree.ParseError as error:
            raise InputError(f"{robot.urdf_path}: is no URDF ({error}); write one") from error

    def compare(self) -> None:
        """
        Raises:
            InputError: for the first difference; the message names both files and the key.
        """
        robot, masses = self.robot, self.root.iterfind("link/inertial/mass")
        self._refuse_unless(self.root.get("name"), "robot name", "name", robot.name)
        try:
            whole = math.fsum(float(mass.get("value", "nan")) for mass in masses)
        except ValueError:
            whole = math.nan
        if not abs(whole - robot.mass) < MASS_TOLERANCE:
            self._refuse_unless(f"{whole:g} kg", "the sum of the masses", "mass", robot.mass)
        joints = {str(joint.get("name")): joint for joint in self.root.iterfind("joint")}
        moving = [name for name, joint in joints.items() if joint.get("type") != "fixed"]
        if moving != list(JOINTS):
            raise InputError(
                f"{robot.urdf_path}: its moving joints are {', '.join(moving)}; name and order "
                f"them {', '.join(JOINTS)}"
            )
        for index, name in enumerate(JOINTS):
            self._compare_joint(joints[name], index, name)
        for leg in LEGS:
            self._compare_shapes(leg)
        shape = self.root.find("link[@name='trunk']/collision/geometry/box")
        self._compare_numbers("trunk's collision box", shape, "size", "trunk_box", robot.trunk_box)

    def _compare_joint(self, joint: Element, index: int, name: str) -> None:
        robot, leg, part = self.robot, index // len(LEG_JOINTS), index % len(LEG_JOINTS)
        kind = LEG_JOINTS[part]
        parent = f"{LEGS[leg]}_{LEG_JOINTS[part - 1]}" if part else "trunk"
        for end, link in (("parent", parent), ("child", name)):
            found = joint.find(end)
            found = None if found is None else found.get("link")
            self._refuse_unless(found, f"joint {name}'s {end}", "name", link)
        axis = joint.find("axis")
        self._compare_numbers(f"joint {name}'s axis", axis, "xyz", "name", AXES[kind])
        key, place = {
            "hip": ("hip_offset", robot.hip_origin[leg]),
            "thigh": ("thigh_offset", [0.0, robot.side[leg] * robot.thigh_offset, 0.0]),
            "calf": ("thigh_length", [0.0, 0.0, -robot.thigh_length]),
        }[kind]
        self._compare_numbers(f"joint {name}'s origin", joint.find("origin"), "xyz", key, place)
        for attribute, key, values in (
            ("lower", "position_limits", robot.lower_limits),
            ("upper", "position_limits", robot.upper_limits),
            ("effort", "effort_limits", robot.effort),
            ("velocity", "velocity_limits", robot.velocity),
        ):
            limit = joint.find("limit")
            self._compare_numbers(f"joint {name}'s limit", limit, attribute, key, values[index])

    def _compare_shapes(self, leg: str) -> None:
        robot, what = self.robot, f"link {leg}_calf's collision {leg}_foot"
        foot = self.root.find(f"link[@name='{leg}_calf']/collision[@name='{leg}_foot']")
        if foot is None:
            raise InputError(f"{robot.urdf_path}: lacks {what}; add a sphere of that name")
        place = [0.0, 0.0, -robot.calf_length]
        self._compare_numbers(what, foot.find("origin"), "xyz", "calf_length", place)
        sphere, radius = foot.find("geometry/sphere"), robot.foot_radius
        self._compare_numbers(what, sphere, "radius", "foot_radius", radius)
        for part, box in (("thigh", robot.thigh_box), ("calf", robot.calf_box)):
            shape = self.root.find(f"link[@name='{leg}_{part}']/collision/geometry/box")
            what = f"link {leg}_{part}'s collision box"
            self._compare_numbers(what, shape, "size", f"{part}_box", box)

    def _compare_numbers(
        self, what: str, element: Element | None, attribute: str, key: str, wanted: Any
    ) -> None:
        text = "" if element is None else element.get(attribute, "")
        try:
            found = [float(word) for word in text.split()]
        except ValueError:
            found = []
        ours = np.atleast_1d(wanted)
        if len(found) != len(ours) or not np.allclose(found, ours, rtol=0.0, atol=TOLERANCE):
            self._refuse_unless(text or None, f"{what}, {attribute},", key, ours.tolist())

    def _refuse_unless(self, found: Any, what: str, key: str, wanted: Any) -> None:
        if found != wanted:
            raise InputError(
                f"{self.robot.urdf_path}: {what} is {found}, and by key {key!r} of "
                f"{self.robot.path} it is {wanted}; make them agree"
            )


def _refuse_other_keys(key: str, given: Mapping[str, Any], known: set[str]) -> None:
    if unknown := sorted(set(given) - known):
        raise InputError(
            f"{key} has the key {shown(unknown[0])}; name kinds of joints, "
            f"{', '.join(LEG_JOINTS)}, or joints, such as RL_thigh"
        )


def _refuse_of_no_body(name: str, body: Inertial) -> None:
    least, middle, greatest = np.linalg.eigvalsh(body.matrix).tolist()
    if least <= 0.0 or least + middle < (1.0 - PHYSICAL) * greatest:
        raise InputError(
            f"inertias has {name} as no body can be: of its principal moments, {least:.4g}, "
            f"{middle:.4g} and {greatest:.4g} kg·m², two must be at least the third, and all "
            "positive; mend a moment, or a product such as ixy"
        )


def _fixed(values: Any) -> Array:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False
    return array
