"""The contract between an exported controller and its robot, as `deploy.yaml` beside the file.

It lists joints and feet in the order of all arrays, their stance, limits and gains, sensors and
commands with units and frames, the rate, and digests of the exported files. A program that moves a
robot first compares it with the robot's numbers.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import yaml

from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.export.c_language import Real
from glassgait.models.export.c_source import Interface, reads_imu
from glassgait.models.files import digest, read_yaml
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.controller import Controller
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import robot_of
from glassgait.models.robots.robot import JointLaw, Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait

CONTRACT = "deploy.yaml"
VERSION = 5

HEADER = """\
# What {name} requires of its robot. Compare it with the robot's numbers before anything moves.
# Arrays are in the order of `joints` and `feet`. In the trunk's frame, x points forward, y to the
# left and z up.
"""

Signals = dict[str, dict[str, Any]]
"""Size, unit and frame of each sensor, command or target, by name."""


def _signal(size: int, unit: str, frame: str = "none") -> dict[str, Any]:
    return {"size": size, "unit": unit, "frame": frame}


SENSORS: Signals = {
    "joint_position": _signal(quadruped.N_JOINTS, "rad"),
    "joint_velocity": _signal(quadruped.N_JOINTS, "rad/s"),
    "foot_contact": _signal(quadruped.N_LEGS, "0 or 1"),
}

IMU: Signals = {
    "angular_velocity": _signal(3, "rad/s", "trunk"),
    "velocity_change": _signal(3, "m/s in a control period, gravity in it", "trunk"),
    "gravity": _signal(3, "1, a unit vector that points down", "trunk"),
}

COMMAND: Signals = {
    "speed": _signal(1, "m/s", "trunk"),
    "yaw_rate": _signal(1, "rad/s", "trunk"),
    "dwell": _signal(1, "control periods"),
}
TARGETS: Signals = {"joint_position": _signal(quadruped.N_JOINTS, "rad")}


def contract_of(
    gait: Gait, controller: Controller, file: Path, policy_name: str, real: Real = "double"
) -> dict[str, Any]:
    """Returns the contract of an exported file, which must exist."""
    policy, robot = controller.policy, controller.robot
    stiffness, damping = controller.joint_law.gains_of(robot)
    units = RobotUnits.of(robot, policy.observation_names)
    affine = units.offset.tolist(), units.scale.tolist()
    contract = {
        # The exported file, policy and gait.
        "version": VERSION,
        "file": file.name,
        "file_digest": digest(file),
        "header_digest": _header_digest(file),
        "policy": policy_name,
        "policy_digest": policy.digest(),
        "numbers": real,
        "gait": gait.name,
        "gait_digest": gait.digest(),
        "rm_states": list(gait.states),
        # The robot and its sensors.
        "estimator": "odometry" if isinstance(controller.estimator, Odometry) else "network",
        **robot_terms(robot),
        "stiffness": stiffness,
        "damping": damping,
        "limited": controller.joint_law.limited,
        "sensors": SENSORS | (IMU if reads_imu(controller) else {}),
        # Commands, targets and observations.
        "command": COMMAND,
        "command_ranges": {
            "speed": [-gait.max_speed, gait.max_speed],
            "yaw_rate": [-gait.max_yaw_rate, gait.max_yaw_rate],
            "dwell": [float(gait.dwell[0]), float(gait.dwell[1])],
        },
        "targets": TARGETS,
        "observations": [
            {"name": entry.name, "unit": entry.unit, "offset": offset, "scale": scale}
            for entry, offset, scale in zip(policy.layout.entries, *affine, strict=True)
        ],
    }
    return {**contract, "digest": _digest(contract)}


def robot_terms(robot: Robot) -> dict[str, Any]:
    """Returns the entries of a contract that depend only on the robot and this project."""
    return {
        "robot": robot.name,
        "control_period": CONTROL_PERIOD,
        "joints": list(quadruped.JOINTS),
        "feet": list(quadruped.LEGS),
        "motor_order": list(robot.motor_order),
        "hip_offset": list(robot.hip_offset),
        "thigh_offset": robot.thigh_offset,
        "thigh_length": robot.thigh_length,
        "calf_length": robot.calf_length,
        "foot_radius": robot.foot_radius,
        "stance": robot.default_stance.tolist(),
        "lower_limits": robot.lower_limits.tolist(),
        "upper_limits": robot.upper_limits.tolist(),
        "effort": robot.effort.tolist(),
        "action_scale": robot.action_scale,
    }


def contract_text(contract: dict[str, Any]) -> str:
    plain = json.loads(json.dumps(contract))
    body = yaml.safe_dump(plain, sort_keys=False, width=100, allow_unicode=True)
    return HEADER.format(name=contract["file"]) + body


def read_contract(path: Path, robot: Robot | None = None) -> dict[str, Any]:
    """Reads a contract, and compares it with its robot and with the files beside it."""
    # Check that the contract was not changed.
    contract = read_yaml(path)
    if not isinstance(contract, dict) or contract.get("version") != VERSION:
        raise InputError(
            f"{path}: is no contract of version {VERSION}; export the controller again"
        )
    if contract.get("digest") != _digest(contract):
        raise InputError(
            f"{path}: key 'digest' does not match the other keys; export the controller again"
        )

    # Compare its numbers with those of the robot.
    terms = robot_terms(robot or robot_of(path, contract["robot"]))
    for key, value in terms.items():
        if contract[key] != value:
            raise InputError(
                f"{path}: key {key!r} is {shown(contract[key])}, and the {terms['robot']} has "
                f"{shown(value)}; export the controller for this robot"
            )

    # Check that the files beside it were not changed.
    file = path.parent / Path(contract["file"]).name
    for key, value in (("file_digest", digest(file)), ("header_digest", _header_digest(file))):
        if contract[key] != value:
            raise InputError(
                f"{path}: key {key!r} does not match {file.name}; export the controller again"
            )
    return contract


def interface_of(contract: dict[str, Any]) -> Interface:
    """Returns the interface of the C file of a contract; raises InputError if it is not C."""
    file = Path(contract["file"])
    if file.suffix != ".c":
        raise InputError(
            f"{CONTRACT}: key 'file' is {shown(file.name)}; export the controller with --format c"
        )
    gains = [contract["stiffness"], contract["damping"]]
    return Interface(
        name=file.stem,
        real=contract["numbers"],
        joint_law=JointLaw.from_plain({"gains": gains, "limited": contract["limited"]}),
        has_imu="gravity" in contract["sensors"],
        has_odometry=contract["estimator"] == "odometry",
    )


def _digest(contract: dict[str, Any]) -> str:
    text = json.dumps({**contract, "digest": ""}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _header_digest(file: Path) -> str:
    header = file.with_suffix(".h")
    return digest(header) if file.suffix == ".c" and header.exists() else "none"
