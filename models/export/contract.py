"""What a robot's computer must agree to before an exported controller moves it: `deploy.yaml`.

The file stands beside the exported one. It names joints and feet in the order of all arrays, their
stance, limits and gains, what is sensed and commanded with units and frames, the rate, and digests
of what was exported. All of it must be there, and be what the robot's own file says.
"""

import hashlib
import json
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, get_args

import yaml
from annotated_types import MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.errors import InputError, shown
from glassgait.models.export.controller import Interface, reads_imu
from glassgait.models.export.language import Real
from glassgait.models.files import digest, read_yaml
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import robot_of
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Count, Positive, Range, Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import REQUESTS, Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationEntry
from glassgait.models.task.odometry import Odometry

CONTRACT = "deploy.yaml"
"""Name of the file."""

Version = Literal[4]
(VERSION,) = get_args(Version)
"""Version of the contract's keys."""

HEADER = """\
# What {name} needs of the robot that it moves. It was written with it, and is to be compared with
# the robot's own numbers before anything moves. Arrays are in the order of `joints` and `feet`; the
# trunk's frame has x ahead, y to the left and z up.
"""

Text = Annotated[str, MinLen(1)]
Names = Annotated[tuple[str, ...], MaxLen(100)]
OfJoints = Annotated[tuple[float, ...], MaxLen(100)]


@checked
class Signal(Settings):
    """What is sensed, commanded or sent.

    Attributes:
        size: Number of its values.
        unit: Their unit.
        frame: The frame that they are of; "none" without one.
    """

    title: ClassVar[str] = "signal"

    size: Count
    unit: Text
    frame: Text = "none"


@checked
class Observed(Settings):
    """An entry of the observation.

    Attributes:
        name: Its name.
        unit: Unit of what is measured.
        offset: What is taken off what is measured, in its unit.
        scale: Factor on the rest, which makes the entry of it.
    """

    title: ClassVar[str] = "observation"

    name: Text
    unit: str
    offset: float
    scale: float


WITHOUT_IMU = {
    "joint_position": Signal(quadruped.N_JOINTS, "rad"),
    "joint_velocity": Signal(quadruped.N_JOINTS, "rad/s"),
    "foot_contact": Signal(quadruped.N_LEGS, "0 or 1"),
}
"""What a controller reads that has no IMU."""

SENSORS = {
    **WITHOUT_IMU,
    "angular_velocity": Signal(3, "rad/s", "trunk"),
    "velocity_change": Signal(3, "m/s in a control period, gravity in it", "trunk"),
    "gravity": Signal(3, "1, a unit vector that points down", "trunk"),
}
"""What one with an IMU reads."""

COMMAND = {
    "speed": Signal(1, "m/s", "trunk"),
    "yaw_rate": Signal(1, "rad/s", "trunk"),
    "dwell": Signal(1, "control periods"),
}
"""What it is asked for."""

TARGETS = {"joint_position": Signal(quadruped.N_JOINTS, "rad")}
"""What it gives."""

GAIT_REQUEST = {"gait": Signal(1, "number of the gait, as in `gaits`, from 0")}
"""What a controller of several gaits is asked for besides."""

DAY_REQUEST = {"request": Signal(1, f"number from 0 of {', '.join(REQUESTS)}")}
DAMPED = {"damped": Signal(1, "1 where joints are to have no stiffness, else 0")}
"""What a controller with a day is asked for and gives besides."""


@checked
class Contract(Settings):
    """What an exported controller needs of its robot.

    Attributes:
        version: Version of these keys.
        file: Name of the exported file.
        file_digest: SHA-256 of its bytes.
        header_digest: The same of the header of a C file beside it; "none" of others.
        policy: What the policy is called.
        policy_digest: Digest of the policy.
        numbers: Type of the numbers that it reads and gives.
        gaits: Digest of each gait by its name, the first one first.
        rm_states: Names of each gait's RM states by the gait's name, in the order of their numbers.
        estimator: What it estimates the trunk's velocity and the feet's heights by.
        robot: Name of the robot.
        control_period: Time between two steps (s).
        joints: Names of the joints, in the order of all arrays of joints.
        feet: Names of the feet, in the order of all arrays of feet.
        motor_order: Legs in the order in which the vendor's controller numbers their motors.
        hip_offset: Distance of a hip joint from the trunk's centre, along x and along y (m).
        thigh_offset: Distance of a thigh joint outward from its hip joint (m).
        thigh_length: From the thigh joint to the knee (m).
        calf_length: From the knee to the foot's centre (m).
        foot_radius: Radius of the feet (m).
        stance: Angles of the default stance (rad).
        lower_limits: Least angles (rad).
        upper_limits: Greatest angles (rad).
        effort: Greatest torques (N·m).
        stiffness: Gain of the joints' position control (N·m/rad).
        damping: Gain of their velocity control (N·m·s/rad).
        action_scale: What an action of 1 adds to a target (rad).
        limited: Whether the robot's end is to follow the nearest targets within the joints' ranges.
        sensors: What the controller reads.
        command: What it is asked for.
        command_ranges: Least and greatest of each command.
        targets: What it gives.
        day: Digest of the robot's day in it; "none" without one.
        observations: What its policy observes, in order.
        digest: SHA-256 of all other keys and values, in their order.
    """

    title: ClassVar[str] = "contract"

    version: Version
    file: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,100}$")]
    file_digest: Text
    header_digest: Text
    policy: Text
    policy_digest: Text
    numbers: Real
    gaits: Annotated[dict[str, str], MinLen(1)]
    rm_states: dict[str, Annotated[Names, MinLen(1)]]
    estimator: Literal["odometry", "network"]
    robot: Text
    control_period: Positive
    joints: Names
    feet: Names
    motor_order: Names
    hip_offset: tuple[float, float]
    thigh_offset: Positive
    thigh_length: Positive
    calf_length: Positive
    foot_radius: Positive
    stance: OfJoints
    lower_limits: OfJoints
    upper_limits: OfJoints
    effort: OfJoints
    stiffness: Positive
    damping: Positive
    action_scale: Positive
    limited: bool
    sensors: dict[str, Signal]
    command: dict[str, Signal]
    command_ranges: dict[str, Range]
    targets: dict[str, Signal]
    day: Text
    observations: Annotated[tuple[Observed, ...], MinLen(1), MaxLen(1000)]
    digest: str

    def text(self) -> str:
        """Returns the file's text."""
        plain = json.loads(json.dumps(asdict(replace(self, digest=self.own_digest()))))
        body = yaml.safe_dump(plain, sort_keys=False, width=100, allow_unicode=True)
        return HEADER.format(name=self.file) + body

    def own_digest(self) -> str:
        """Returns the digest of all but the digest."""
        # A gait's number is its place in `gaits`, so that the order of all entries counts.
        text = json.dumps(asdict(replace(self, digest="")))
        return hashlib.sha256(text.encode()).hexdigest()

    def check(self, robot: Robot) -> None:
        """
        Raises:
            InputError: if it was made for another robot, rate, order, unit or number; the message
                names the key.
        """
        if self.robot != robot.name:
            raise InputError(
                f"{CONTRACT}: key 'robot' is {shown(self.robot)}, not {shown(robot.name)}; move "
                "that robot, or export the controller for this one"
            )
        for key, own in terms_of(robot).items():
            if getattr(self, key) != own:
                raise InputError(
                    f"{CONTRACT}: key {key!r} is not that of the {robot.name}, {own}; export the "
                    "controller for this robot"
                )
        if self.sensors not in (SENSORS, WITHOUT_IMU):
            raise InputError(
                f"{CONTRACT}: key 'sensors' is not what controllers read; export the controller "
                "again"
            )
        if list(self.rm_states) != list(self.gaits):
            raise InputError(
                f"{CONTRACT}: key 'rm_states' does not name the gaits of the key 'gaits' in their "
                "order; export the controller again"
            )
        if self.digest != self.own_digest():
            raise InputError(
                f"{CONTRACT}: key 'digest' is not that of the others; one was changed, so export "
                "the controller again"
            )

    @property
    def max_speed(self) -> float:
        """Greatest speed that may be commanded (m/s)."""
        return self.command_ranges["speed"][1]

    @property
    def max_yaw_rate(self) -> float:
        """Greatest yaw rate that may be commanded (rad/s)."""
        return self.command_ranges["yaw_rate"][1]

    @property
    def dwell(self) -> tuple[int, int]:
        """Least and greatest dwell that may be commanded (control steps)."""
        least, greatest = self.command_ranges["dwell"]
        return round(least), round(greatest)

    def interface(self) -> Interface:
        """Returns how the controller's C file is called.

        Raises:
            InputError: if the exported file is none.
        """
        name, _, ending = self.file.rpartition(".")
        if ending != "c":
            raise InputError(
                f"{CONTRACT}: key 'file' is {shown(self.file)}, which holds a policy alone; export "
                "the controller with --format c"
            )
        return Interface(
            name=name,
            real=self.numbers,
            n_states=tuple(len(states) for states in self.rm_states.values()),
            joint_law=JointLaw((self.stiffness, self.damping), self.limited),
            has_imu=self.sensors == SENSORS,
            has_odometry=self.estimator == "odometry",
            has_day="request" in self.command,
        )


def terms_of(robot: Robot) -> dict[str, Any]:
    """Returns what a contract holds of a robot and of this project, by key."""
    return {
        "robot": robot.name,
        "control_period": CONTROL_PERIOD,
        "joints": quadruped.JOINTS,
        "feet": quadruped.LEGS,
        "motor_order": robot.motor_order,
        "hip_offset": robot.hip_offset,
        "thigh_offset": robot.thigh_offset,
        "thigh_length": robot.thigh_length,
        "calf_length": robot.calf_length,
        "foot_radius": robot.foot_radius,
        "stance": tuple(robot.default_stance.tolist()),
        "lower_limits": tuple(robot.lower_limits.tolist()),
        "upper_limits": tuple(robot.upper_limits.tolist()),
        "effort": tuple(robot.effort.tolist()),
        "action_scale": robot.action_scale,
    }


def contract_of(
    gait: Gait | GaitSwitch,
    controller: AlternatingController,
    file: Path,
    policy_name: str,
    day: Day | None = None,
    real: Real = "double",
) -> Contract:
    """Returns the contract of an exported file.

    Args:
        gait: The gait, or several.
        controller: What was exported.
        file: The exported file, as it was written.
        policy_name: What the policy is called.
        day: The robot's day in it.
        real: Type of the numbers that it reads and gives.

    Raises:
        InputError: if two gaits have one name.
    """
    policy, robot = controller.policy, controller.robot
    gaits = gait.gaits if isinstance(gait, GaitSwitch) else [gait]
    if len({one.name for one in gaits}) < len(gaits):
        raise InputError(
            f"{CONTRACT}: two of the gaits {', '.join(one.name for one in gaits)} have one name; "
            "give their files other names"
        )
    first = policy.policies[0] if isinstance(policy, SwitchedPolicy) else policy
    stiffness, damping = controller.joint_law.gains_of(robot)
    own = gait.gait if isinstance(gait, GaitSwitch) else gait
    requests = {**(GAIT_REQUEST if len(gaits) > 1 else {}), **(DAY_REQUEST if day else {})}
    made = Contract(
        version=VERSION,
        file=file.name,
        file_digest=digest(file),
        header_digest=_header_digest(file),
        policy=policy_name,
        policy_digest=policy.digest(),
        numbers=real,
        gaits={one.name: one.digest() for one in gaits},
        rm_states={one.name: tuple(one.states) for one in gaits},
        estimator="odometry" if isinstance(controller.estimator, Odometry) else "network",
        stiffness=stiffness,
        damping=damping,
        limited=controller.joint_law.limited,
        command_ranges=ranges_of(own),
        sensors=SENSORS if reads_imu(controller) else WITHOUT_IMU,
        observations=tuple(
            Observed(entry.name, entry.unit, _offset(entry, robot), entry.scale(robot))
            for entry in first.layout.entries
        ),
        command=COMMAND | requests,
        targets=TARGETS | (DAMPED if day else {}),
        day="none" if day is None else day.digest(),
        digest="",
        **terms_of(robot),
    )
    return replace(made, digest=made.own_digest())


def ranges_of(gait: Gait) -> dict[str, tuple[float, float]]:
    """Returns the least and greatest of each command that a gait is made for."""
    return {
        "speed": (-gait.max_speed, gait.max_speed),
        "yaw_rate": (-gait.max_yaw_rate, gait.max_yaw_rate),
        "dwell": (float(gait.dwell[0]), float(gait.dwell[1])),
    }


def _offset(entry: ObservationEntry, robot: Robot) -> float:
    """Returns what is taken off a quantity: joints and their targets count from the stance."""
    if entry.group not in ("joint position", "previous action"):
        return 0.0
    _, joint = entry.symbol.rsplit(".", 1)
    return float(robot.default_stance[quadruped.joint_index(joint)])


def read_contract(path: Path, robot: Robot | None = None) -> tuple[Contract, Path, Robot]:
    """Reads a contract, and returns it with the path of the controller's file beside it, and the
    robot.

    Args:
        path: A `deploy.yaml`.
        robot: The robot that is to be moved; by default the one of its name, which must ship.

    Raises:
        InputError: if a key is missing or unknown, a value is not the robot's, or the file beside
            it is missing or another one than was exported.
    """
    found = read_yaml(path)
    if not isinstance(found, dict):
        raise InputError(f"{path}: is not a mapping; export the controller again")
    for key in (own.name for own in fields(Contract)):
        if key not in found:
            raise InputError(f"{path}: lacks the key {key!r}; export the controller again")
    if type(found["version"]) is not int:
        given = shown(found["version"])
        raise InputError(f"{path}: key 'version' is {given}; it must be {VERSION}")
    contract = Contract.from_plain(found, str(path))
    if robot is None:
        robot = robot_of(path, contract.robot)
    try:
        contract.check(robot)
    except InputError as error:
        raise InputError(f"{path.parent / str(error)}") from error
    file = path.parent / contract.file
    if file.parent != path.parent or digest(file) != contract.file_digest:
        raise InputError(
            f"{path}: key 'file_digest' is not that of {file.name}; one of the two was changed, so "
            "export the controller again"
        )
    if _header_digest(file) != contract.header_digest:
        raise InputError(
            f"{path}: key 'header_digest' is not that of {file.with_suffix('.h').name}; one of the "
            "two was changed, so export the controller again"
        )
    return contract, file, robot


def _header_digest(file: Path) -> str:
    header = file.with_suffix(".h")
    return digest(header) if file.suffix == ".c" and header.exists() else "none"
