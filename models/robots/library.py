"""Loads robots from files, `<name>/robot.yaml` and a URDF. Adding a robot takes no code."""

import copyreg
from functools import cache
from pathlib import Path
from typing import Any

from glassgait.models.errors import InputError, shown, unknown_name
from glassgait.models.files import read_yaml
from glassgait.models.robots.quadruped import LEG_JOINTS, LEGS
from glassgait.models.robots.robot import DEFAULT_ROBOT, ROBOT_DIRECTORY, Robot
from glassgait.models.robots.urdf import Urdf

ROBOT_FILE = "robot.yaml"

DEFAULT_JOINTS = {leg: [f"{leg}_{kind}" for kind in LEG_JOINTS] for leg in LEGS}
"""Names of the joints in a URDF, unless `robot.yaml` gives others."""


def robot_names() -> tuple[str, ...]:
    """Lists the robots that ship with the project, the default one first."""
    names = (path.parent.name for path in ROBOT_DIRECTORY.glob(f"*/{ROBOT_FILE}"))
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_ROBOT, name)))


def load_robot(robot: str | Path = DEFAULT_ROBOT) -> Robot:
    """Loads a shipped robot by name, or another from its file; reloads a file that changed."""
    path = Path(robot)
    if path.is_dir() and str(robot) not in robot_names():
        raise InputError(f"{path}: is a folder; give the robot's file, {path / ROBOT_FILE}")
    if path.suffix not in (".yaml", ".yml"):
        if str(robot) not in robot_names():
            remedy = ", or give the path of a robot's file ending in .yaml"
            raise unknown_name("robot", robot, robot_names(), remedy)
        path = ROBOT_DIRECTORY / str(robot) / ROBOT_FILE
    path = path.resolve()
    return _load(path, path.stat().st_mtime_ns if path.exists() else 0)


def robot_of(path: Path, name: object, robot: Robot | None = None) -> Robot:
    """Returns the robot that a file's key "robot" names, by default the default robot.

    It must be `robot` if that is given, otherwise a shipped robot.
    """
    name = DEFAULT_ROBOT if name is None else name
    if robot is None:
        if name not in robot_names():
            raise InputError(
                f"{path}: key 'robot' is {shown(name)}, and no such robot ships; give its "
                "robot.yaml with --robot"
            )
        return load_robot(str(name))
    if name != robot.name:
        raise InputError(
            f"{path}: is of robot {shown(name)} (key 'robot'), not {robot.name!r}; give a file of "
            f"the {robot.name}, or --robot {name}"
        )
    return robot


def robot_folder(directory: Path, robot: str = DEFAULT_ROBOT) -> Path:
    """Returns a robot's folder in a directory of files or runs."""
    return directory if robot == DEFAULT_ROBOT else directory / robot


@cache
def _load(path: Path, _edited: int) -> Robot:
    values = read_yaml(path)
    if not isinstance(values, dict) or not isinstance(values.get("description"), str):
        raise InputError(f"{path}: lacks the key 'description'; name a URDF in the same folder")
    joints = values.pop("joints", DEFAULT_JOINTS)
    if not _are_joints(joints):
        raise InputError(
            f"{path}: key 'joints' is {shown(joints)}; name hip, thigh and calf for each of "
            f"{', '.join(LEGS)}"
        )
    from_urdf = Urdf(path.parent / values["description"], joints).fields()
    if twice := sorted({*values} & {*from_urdf, "path"}):
        raise InputError(f"{path}: key {twice[0]!r} is read from the URDF; remove it")
    try:
        robot = Robot.from_plain({**values, **from_urdf, "path": str(path)})
    except InputError as error:
        key = str(error).partition(" ")[0].partition("[")[0]
        file = path.parent / values["description"] if key in from_urdf else path
        raise InputError(f"{file}: {error}") from error
    if robot.name in robot_names() and not robot.is_shipped:
        raise InputError(
            f"{path}: name is {robot.name!r}, a robot that ships; give it another name"
        )
    return robot


def _are_joints(joints: Any) -> bool:
    if not isinstance(joints, dict) or {*joints} != {*LEGS}:
        return False
    return all(isinstance(leg, list) and [*map(type, leg)] == [str] * 3 for leg in joints.values())


# Copying or unpickling a robot loads its file, so that a process has one object for each robot.
copyreg.pickle(Robot, lambda robot: (load_robot, (robot.path,)))
