"""`glassgait policy convert`: convert the files of other projects to descriptions."""

import os
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro
import yaml

from glassgait.models.errors import InputError, brief, shown, unknown_name
from glassgait.models.files import read_yaml, write_atomically
from glassgait.models.policies.described import described
from glassgait.models.policies.library import naming
from glassgait.models.robots.library import load_robot, robot_names
from glassgait.models.robots.quadruped import LEG_JOINTS
from glassgait.models.settings import Settings, checked
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import DESCRIPTION_SUFFIXES

RL_SAR = {
    "lin_vel": ("base_velocity", "lin_vel_scale"),
    "ang_vel": ("angular_velocity", "ang_vel_scale"),
    "gravity_vec": ("gravity", None),
    "commands": ("command", "commands_scale"),
    "dof_pos": ("joint_position", "dof_pos_scale"),
    "dof_vel": ("joint_velocity", "dof_vel_scale"),
    "actions": ("last_action", None),
}
"""Term and key of the scale, by the name of the observation in rl_sar."""

UNITREE = {
    "base_lin_vel": "base_velocity",
    "base_ang_vel": "angular_velocity",
    "projected_gravity": "gravity",
    "velocity_commands": "command",
    "keyboard_velocity_commands": "command",
    "joint_pos_rel": "joint_position",
    "joint_vel_rel": "joint_velocity",
    "last_action": "last_action",
    "gait_phase": "clock",
}
"""Term by the name of the observation in unitree_rl_mjlab and unitree_rl_lab."""

ACTION_KEYS = ("scale", "offset", "clip", "joint_names", "joint_ids")
BEYOND = 10.0  # angle that no joint reaches (rad)


@checked
class ConvertPolicy(Settings):
    """Write the description of a network from rl_sar's config.yaml or Unitree's deploy.yaml.

    unitree_rl_mjlab and unitree_rl_lab write deploy.yaml. What rl_sar's config.yaml leaves out is
    read from base.yaml in the folder above it, if it exists. Options add what is still missing, and
    take precedence over the files.

    Attributes:
        config: config.yaml or deploy.yaml.
        description: File to write.
        robot: Name of the robot, or path of its robot.yaml.
        weights: ONNX file, or checkpoint of rsl_rl; by default the one that config.yaml names.
        joints: Names of all joints in the network's order, such as FR_hip FR_thigh.
        period: Period of the network's control step (s), which must be 0.02.
        overwrite: Replace an existing description.
        check: Check the description at once, as `policy check` does.
    """

    title: ClassVar[str] = "policy convert"

    config: Annotated[Path, tyro.conf.Positional]
    description: Path = Path("policy.yaml")
    robot: str | None = None
    weights: Path | None = None
    joints: tuple[str, ...] | None = None
    period: float | None = None
    overwrite: bool = False
    check: bool = False

    def run(self) -> None:
        """Writes the description and, if asked, checks it."""
        if self.description.exists() and not self.overwrite:
            raise InputError(f"{self.description}: exists; add --overwrite to replace it")
        is_config = self.description.resolve() == self.config.resolve()
        if is_config or self.description.suffix not in DESCRIPTION_SUFFIXES:
            raise InputError(f"{self.description}: is no description; name another .yaml file")
        try:
            with naming(self.config):
                values = read_yaml(self.config)
                read = self._unitree if "joint_ids_map" in values else self._rl_sar
                plain = read(values)
        except KeyError as error:
            raise InputError(f"{self.config}: lacks the key {error}; add it") from error
        except (TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(
                f"{self.config}: is no config of a quadruped ({brief(str(error))}); give another"
            ) from error
        # Refuse a bad network before the file is written, whose folder may not exist yet.
        described(plain, self.config)
        plain["weights"] = os.path.relpath(plain["weights"], self.description.parent.resolve())
        text = yaml.safe_dump(plain, sort_keys=False, default_flow_style=None)
        write_atomically(self.description, text)
        console.print(f"description written to {self.description}")
        if self.check:
            from glassgait.studies.evaluation.policy_check import CheckPolicy

            CheckPolicy(self.description).run()

    def _rl_sar(self, values: Any) -> dict[str, Any]:
        # Complete the network's file by the robot's.
        ((name, config),) = values.items()
        base = self.config.resolve().parents[1] / "base.yaml"
        (shared,) = read_yaml(base).values() if base.exists() else ({},)
        config, period = shared | config, self.period
        joints: Any = self.joints
        if "dt" in config:
            period = period or round(config["dt"] * config["decimation"], 9)
        if "joint_names" in config:
            named = [joint.removesuffix("_joint") for joint in config["joint_names"]]
            joints = joints or [named[index] for index in config["joint_mapping"]]
        # What the network observes.
        frames = config["observations_history"] or [0]
        forward = [*range(len(frames))]
        if frames not in (forward, forward[::-1]):
            raise InputError(f"observations_history is {shown(frames)}; give all frames in order")
        order = "newest_first" if frames == forward else "oldest_first"
        by = "term" if config["observations_history_priority"] == "term" else "frame"
        limit = _same("clip_actions_upper", config["clip_actions_upper"])
        gains = {"stiffness": "rl_kp", "damping": "rl_kd"}
        terms = [_known(seen, RL_SAR) for seen in config["observations"]]
        # The description.
        robot = name.partition("/")[0]
        robot = self._given("robot", self.robot or (robot in robot_names() and robot))
        return {
            "robot": load_robot(robot).source,
            "weights": _absolute(self.weights or self.config.with_name(config["model_name"])),
            "period": self._given("period", period),
            "observation": [
                {"term": term, "scale": config[key] if key else 1.0} for term, key in terms
            ],
            "history": {"length": len(frames), "order": order, "by": by},
            "clip": {"observation": config["clip_obs"], "action": limit},
            "joints": [*self._given("joints", joints)],
            "gains": {key: _by_joint(joints, config, name) for key, name in gains.items()},
            "default": _by_joint(joints, config, "default_dof_pos"),
            "action_scale": _by_joint(joints, config, "action_scale"),
        }

    def _unitree(self, config: Any) -> dict[str, Any]:
        # The file names no joints: gains are in the motors' order, all else in the network's.
        robot = load_robot(self._given("robot", self.robot))
        motors = [f"{leg}_{joint}" for leg in robot.motor_order for joint in LEG_JOINTS]
        joints = self.joints or [motors[index] for index in config["joint_ids_map"]]
        action = config["actions"]["JointPositionAction"]
        if unknown := sorted({*action} - {*ACTION_KEYS}):
            raise InputError(f"actions have the key {unknown[0]!r}, unknown here; remove it")
        if action["clip"] is not None and np.abs(action["clip"]).min() < BEYOND:
            raise InputError(f"clip of actions is {shown(action['clip'])}; set it to null")
        if action["offset"] != config["default_joint_pos"]:
            raise InputError("offset differs from default_joint_pos; make them equal")
        # What the network observes.
        terms = dict(config["observations"])
        by = "frame" if terms.pop("use_gym_history", False) else "term"
        lengths = [term["history_length"] for term in terms.values()]
        ranges = config["commands"]["base_velocity"]["ranges"]
        axes = ("forward", "lin_vel_x"), ("left", "lin_vel_y"), ("yaw", "ang_vel_z")
        return {
            "robot": robot.source,
            "weights": _absolute(self._given("weights", self.weights)),
            "period": self.period or config["step_dt"],
            "observation": [_term(_known(seen, UNITREE), term) for seen, term in terms.items()],
            "history": {"length": _same("history_length", lengths), "by": by},
            "gains": {key: _by_joint(motors, config, key) for key in ("stiffness", "damping")},
            "joints": [*joints],
            "default": _by_joint(joints, config, "default_joint_pos"),
            "action_scale": _by_joint(joints, action, "scale"),
            "commands": {key: ranges[axis] for key, axis in axes},
        }

    def _given(self, option: str, value: Any) -> Any:
        if not value:
            raise InputError(f"does not name the {option}; give --{option}")
        return value


def _absolute(path: Path) -> str:
    # Keep the name of a link, whose suffix says what the file holds.
    return str(path.parent.resolve() / path.name)


def _same(key: str, values: list[float]) -> float:
    if len({*values}) != 1:
        raise InputError(f"{key} is {shown(values)}; give one number, as for all joints")
    return values[0]


def _known(name: str, terms: dict[str, Any]) -> Any:
    if name not in terms:
        raise unknown_name("observation", name, terms)
    return terms[name]


def _term(name: str, term: dict[str, Any]) -> dict[str, Any]:
    """Returns a term of a description; its clip comes before its scale in both."""
    period = term["params"].get("period")
    values = {"scale": term["scale"], "clip": term["clip"], "period": period}
    return {"term": name} | {key: value for key, value in values.items() if value is not None}


def _by_joint(joints: Any, config: Any, key: str) -> dict[str, float]:
    """Returns a key's values by joint, or by kind of joint if all legs are alike."""
    if len(config[key]) != len(joints):
        raise InputError(f"{key} has {len(config[key])} numbers for {len(joints)} joints; give all")
    named = dict(zip(joints, config[key], strict=True))
    kinds = {joint.partition("_")[2]: value for joint, value in named.items()}
    alike = all(kinds[joint.partition("_")[2]] == value for joint, value in named.items())
    return kinds if alike else named
