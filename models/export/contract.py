"""What a robot's computer must agree to before an exported controller moves it: `deploy.yaml`.

The file stands beside the exported one. It names joints and feet in the order of all arrays, their
stance, limits and gains, what is sensed and commanded with units and frames, the rate, and digests
of what was exported. All of it must be there, and be what the robot's own file says.
"""

import hashlib
import json
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import yaml
from annotated_types import MaxLen, MinLen
from pydantic import StringConstraints

from glassgait.models.errors import InputError, shown
from glassgait.models.files import digest, read_yaml
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import Count, Positive, Range, Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import REQUESTS, Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import ObservationEntry

CONTRACT = "deploy.yaml"
"""Name of the file."""

HEADER = """\
# What {name} needs of the robot that it moves. It was written with it, and is to be compared with
# the robot's own numbers before anything moves. Arrays are in the order of `joints` and `feet`; the
# trunk's frame has x ahead, y to the left and z up.
"""

Text = Annotated[str, MinLen(1)]
Names = Annotated[tuple[str, ...], MaxLen(100)]
OfJoints = Annotated[tuple[float, ...], MaxLen(100)]


@dataclass(frozen=True)
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


@dataclass(frozen=True)
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


SENSORS = {
    "joint_position": Signal(quadruped.N_JOINTS, "rad"),
    "joint_velocity": Signal(quadruped.N_JOINTS, "rad/s"),
    "foot_contact": Signal(quadruped.N_LEGS, "0 or 1"),
    "angular_velocity": Signal(3, "rad/s", "trunk"),
    "velocity_change": Signal(3, "m/s in a control period, gravity in it", "trunk"),
    "gravity": Signal(3, "1, a unit vector that points down", "trunk"),
}
"""What a controller reads."""

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


@dataclass(frozen=True)
class Contract(Settings):
    """What an exported controller needs of its robot.

    Attributes:
        version: Version of these keys.
        file: Name of the exported file.
        file_digest: SHA-256 of its bytes.
        policy: What the policy is called.
        policy_digest: Digest of the policy.
        gaits: Digest of each gait by its name, the first one first.
        robot: Name of the robot.
        control_period: Time between two steps (s).
        joints: Names of the joints, in the order of all arrays of joints.
        feet: Names of the feet, in the order of all arrays of feet.
        motor_order: Legs in the order in which the vendor's controller numbers their motors.
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
        digest: SHA-256 of all other keys and values.
    """

    title: ClassVar[str] = "contract"

    version: Literal[1]
    file: Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.-]{1,100}$")]
    file_digest: Text
    policy: Text
    policy_digest: Text
    gaits: Annotated[dict[str, str], MinLen(1)]
    robot: Text
    control_period: Positive
    joints: Names
    feet: Names
    motor_order: Names
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
        text = json.dumps(asdict(replace(self, digest="")), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def check(self, robot: Robot) -> None:
        """
        Raises:
            InputError: if it was made for another robot, rate, order, unit or number; the message
                names the key.
        """
        for key, own in terms_of(robot).items():
            if getattr(self, key) != own:
                raise InputError(
                    f"{CONTRACT}: key {key!r} is not that of the {robot.name}, {own}; export the "
                    "controller for this robot"
                )
        if self.digest != self.own_digest():
            raise InputError(
                f"{CONTRACT}: key 'digest' is not that of the others; one was changed, so export "
                "the controller again"
            )


def terms_of(robot: Robot) -> dict[str, object]:
    """Returns what a contract holds of a robot and of this project, by key."""
    return {
        "robot": robot.name,
        "control_period": CONTROL_PERIOD,
        "joints": quadruped.JOINTS,
        "feet": quadruped.LEGS,
        "motor_order": robot.motor_order,
        "stance": tuple(robot.default_stance.tolist()),
        "lower_limits": tuple(robot.lower_limits.tolist()),
        "upper_limits": tuple(robot.upper_limits.tolist()),
        "effort": tuple(robot.effort.tolist()),
        "action_scale": robot.action_scale,
        "sensors": SENSORS,
    }


def contract_of(
    gait: Gait | GaitSwitch,
    controller: AlternatingController,
    file: Path,
    policy_name: str,
    day: Day | None = None,
) -> Contract:
    """Returns the contract of an exported file.

    Args:
        gait: The gait, or several.
        controller: What was exported.
        file: The exported file, as it was written.
        policy_name: What the policy is called.
        day: The robot's day in it.
    """
    policy, robot = controller.policy, controller.robot
    gaits = gait.gaits if isinstance(gait, GaitSwitch) else [gait]
    first = policy.policies[0] if isinstance(policy, SwitchedPolicy) else policy
    stiffness, damping = controller.joint_law.gains_of(robot)
    own = gait.gait if isinstance(gait, GaitSwitch) else gait
    requests = {**(GAIT_REQUEST if len(gaits) > 1 else {}), **(DAY_REQUEST if day else {})}
    made = Contract(
        version=1,
        file=file.name,
        file_digest=digest(file),
        policy=policy_name,
        policy_digest=policy.digest(),
        gaits={one.name: one.digest() for one in gaits},
        stiffness=stiffness,
        damping=damping,
        limited=controller.joint_law.limited,
        command_ranges={
            "speed": (-own.max_speed, own.max_speed),
            "yaw_rate": (-own.max_yaw_rate, own.max_yaw_rate),
            "dwell": (float(own.dwell[0]), float(own.dwell[1])),
        },
        observations=tuple(
            Observed(entry.name, entry.unit, _offset(entry, robot), entry.scale(robot))
            for entry in first.layout.entries
        ),
        command=COMMAND | requests,
        targets=TARGETS | (DAMPED if day else {}),
        day="none" if day is None else day.digest(),
        digest="",
        **terms_of(robot),  # pyright: ignore[reportArgumentType]
    )
    return replace(made, digest=made.own_digest())


def _offset(entry: ObservationEntry, robot: Robot) -> float:
    """Returns what is taken off a quantity: joints and their targets count from the stance."""
    if entry.group not in ("joint position", "previous action"):
        return 0.0
    _, joint = entry.symbol.rsplit(".", 1)
    return float(robot.default_stance[quadruped.joint_index(joint)])


def read_contract(path: Path, robot: Robot) -> tuple[Contract, Path]:
    """Reads a contract, and returns it with the path of the controller's file beside it.

    Args:
        path: A `deploy.yaml`.
        robot: The robot that is to be moved.

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
        raise InputError(f"{path}: key 'version' is {shown(found['version'])}; it must be 1")
    contract = Contract.from_plain(found, str(path))
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
    return contract, file
