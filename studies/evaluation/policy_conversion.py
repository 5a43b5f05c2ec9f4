"""`glassgait policy convert`: descriptions from the files of rl_sar."""

import os
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro
import yaml

from glassgait.models.errors import InputError, shown, unknown_name
from glassgait.models.files import read_yaml, write_atomically
from glassgait.models.policies.described import load_described
from glassgait.models.policies.library import naming
from glassgait.models.robots.library import robot_names
from glassgait.models.settings import Settings, checked
from glassgait.studies.common.console import console
from glassgait.studies.evaluation.policy_check import CheckPolicy

RL_SAR = {
    "lin_vel": ("base_velocity", "lin_vel_scale"),
    "ang_vel": ("angular_velocity", "ang_vel_scale"),
    "gravity_vec": ("gravity", None),
    "commands": ("command", "commands_scale"),
    "dof_pos": ("joint_position", "dof_pos_scale"),
    "dof_vel": ("joint_velocity", "dof_vel_scale"),
    "actions": ("last_action", None),
}
"""Term and key of the scale of each observation of rl_sar."""


@checked
class ConvertPolicy(Settings):
    """Write the description of a network from rl_sar's config.yaml.

    Options give what the file leaves out; they take precedence. The file base.yaml in the folder
    above is read too, if it exists.

    Attributes:
        description: File to write.
        robot: Name of a robot.
        weights: ONNX file.
        joints: Joints in the network's order, such as FR_hip.
        period: Period of the control step (s).
        check: Check the description at once, as `policy check` does.
    """

    title: ClassVar[str] = "policy convert"

    config: Annotated[Path, tyro.conf.Positional]
    description: Path = Path("policy.yaml")
    robot: str | None = None
    weights: Path | None = None
    joints: tuple[str, ...] | None = None
    period: float | None = None
    check: bool = False

    def run(self) -> None:
        """Writes the description and checks it."""
        try:
            with naming(self.config):
                plain = self._read(read_yaml(self.config))
        except KeyError as error:
            raise InputError(f"{self.config}: lacks the key {error}; add it") from error
        except (TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(f"{self.config}: is no config of a quadruped; give another") from error
        write_atomically(self.description, yaml.safe_dump(plain, sort_keys=False))
        try:
            load_described(self.description)
        except InputError:
            self.description.unlink()
            raise
        console.print(f"description written to {self.description}")
        if self.check:
            CheckPolicy(self.description).run()

    def _read(self, values: Any) -> dict[str, Any]:
        # The network's file is completed by the robot's.
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
        if unknown := [seen for seen in config["observations"] if seen not in RL_SAR]:
            raise unknown_name("observation", unknown[0], RL_SAR)
        terms = [RL_SAR[seen] for seen in config["observations"]]
        # The description.
        robot = name.partition("/")[0]
        network = self.config.with_name(config["model_name"])
        return {
            "robot": self._given("robot", self.robot or (robot in robot_names() and robot)),
            "weights": os.path.relpath(self.weights or network, self.description.parent),
            "period": self._given("period", period),
            "observation": [
                {"term": term, "scale": config[key] if key else 1.0} for term, key in terms
            ],
            "history": {"length": len(frames), "order": order, "by": by},
            "clip": {"observation": config["clip_obs"], "action": limit},
            "gains": {key: _same(name, config[name]) for key, name in gains.items()},
            "joints": [*self._given("joints", joints)],
            "default": dict(zip(joints, config["default_dof_pos"], strict=True)),
            "action_scale": dict(zip(joints, config["action_scale"], strict=True)),
        }

    def _given(self, option: str, value: Any) -> Any:
        if not value:
            raise InputError(f"does not name the {option}; give --{option}")
        return value


def _same(key: str, values: list[float]) -> float:
    if len({*values}) != 1:
        raise InputError(f"{key} is {shown(values)}; give one number, as for all joints")
    return float(values[0])
