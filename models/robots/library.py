"""Robots of files: `<name>/robot.yaml` and a URDF. Adding a robot takes no code."""

import copyreg
import math
from functools import cache
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import numpy as np

from glassgait.models.errors import InputError, shown
from glassgait.models.files import read_text, read_yaml
from glassgait.models.robots.quadruped import AXES, JOINTS, LEG_JOINTS, LEGS
from glassgait.models.robots.robot import DEFAULT_ROBOT, ROBOT_DIRECTORY, Robot

ROBOT_FILE = "robot.yaml"

LARGEST = 10_000_000  # greatest size of a URDF (bytes)
TOLERANCE = 1e-6  # greatest difference between legs (m); a URDF holds some six digits


def robot_names() -> tuple[str, ...]:
    """Lists the robots that ship with the project, the default one first."""
    names = (path.parent.name for path in ROBOT_DIRECTORY.glob(f"*/{ROBOT_FILE}"))
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_ROBOT, name)))


def load_robot(robot: str | Path = DEFAULT_ROBOT) -> Robot:
    """Loads a robot that ships by its name, or another from its file, once a process and edit."""
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
    """Returns the robot that a file is of, by its key "robot"; without one, the default robot.

    The file has to be of `robot` if that is given, else of any robot that ships.
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
    found = read_yaml(path)
    if not isinstance(found, dict) or not isinstance(found.get("description"), str):
        raise InputError(f"{path}: lacks the key 'description'; name the URDF beside the file")
    measured = _Urdf(path.parent / found["description"]).fields()
    if twice := sorted({*found} & {*measured, "path"}):
        raise InputError(f"{path}: key {twice[0]!r} is what the URDF says; remove it")
    robot = Robot.from_plain({**found, **measured, "path": str(path)}, str(path))
    if robot.name in robot_names() and not robot.is_shipped:
        raise InputError(
            f"{path}: name is {robot.name!r}, a robot that ships; give it another name"
        )
    return robot


# A copy of a robot, and what another process gets, is the one that the file stands for.
copyreg.pickle(Robot, lambda robot: (load_robot, (robot.path,)))


class _Urdf:
    """A parsed URDF, and the fields of a robot that it holds."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._root = ElementTree.fromstring(read_text(path, LARGEST))
        except ElementTree.ParseError as error:
            raise InputError(f"{path}: is not a URDF ({error}); mend it") from error

    def fields(self) -> dict[str, Any]:
        moving = [
            joint.get("name")
            for joint in self._root.iterfind("joint")
            if joint.get("type") != "fixed"
        ]
        if moving != list(JOINTS):
            self._refuse(
                f"its moving joints are {', '.join(map(str, moving))}; name and order them "
                f"{', '.join(JOINTS)}"
            )

        # Sizes of the front left leg, which the other legs have to share.
        first, *others = [self._leg(leg) for leg in LEGS]
        for leg, other in zip(LEGS[1:], others, strict=True):
            for key, value in other.items():
                if not np.allclose(value, first[key], rtol=0.0, atol=TOLERANCE):
                    self._refuse(
                        f"{key} of {leg} is {value}, and that of FL is {first[key]}; make the legs "
                        "mirror images of each other"
                    )
        # Limits of each joint and the mass of all links.
        limits = {
            key: [self._number(f"joint[@name='{joint}']/limit", key) for joint in JOINTS]
            for key in ("lower", "upper", "effort", "velocity")
        }
        masses = (mass.get("value", "nan") for mass in self._root.iterfind("link/inertial/mass"))
        return {
            "mass": math.fsum(self._floats("mass", " ".join(masses))),
            "trunk_box": self._numbers("link[@name='trunk']/collision/geometry/box", "size", 3),
            **first,
            "position_limits": [*zip(limits["lower"], limits["upper"], strict=True)],
            "effort_limits": limits["effort"],
            "velocity_limits": limits["velocity"],
        }

    def _leg(self, leg: str) -> dict[str, Any]:
        """Returns the sizes of a leg, mirrored to those of the front left one."""
        # Links and axes of the joints.
        parents = ("trunk", f"{leg}_hip", f"{leg}_thigh")
        for parent, kind in zip(parents, LEG_JOINTS, strict=True):
            joint = f"joint[@name='{leg}_{kind}']"
            for end, link in (("parent", parent), ("child", f"{leg}_{kind}")):
                if self._text(f"{joint}/{end}", "link") != link:
                    self._refuse(f"joint {leg}_{kind}'s {end} is not link {link}; rename one")
            if self._numbers(f"{joint}/axis", "xyz", 3) != list(AXES[kind]):
                self._refuse(f"joint {leg}_{kind}'s axis is not {AXES[kind]}; turn its frame")
        # Places of joints and foot, each in the frame of the link before.
        calf = f"link[@name='{leg}_calf']/collision"
        foot = f"{calf}[@name='{leg}_foot']"
        hip, thigh, knee, end = (
            self._numbers(place, "xyz", 3)
            for place in (
                *(f"joint[@name='{leg}_{kind}']/origin" for kind in LEG_JOINTS),
                f"{foot}/origin",
            )
        )
        if any(map(abs, (hip[2], thigh[0], thigh[2], *knee[:2], *end[:2]))):
            self._refuse(
                f"leg {leg} does not hang straight down at angles 0, from a hip joint as high as "
                "the trunk's centre; move its joints' origins"
            )
        ahead, left = (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)
        thigh_box = f"link[@name='{leg}_thigh']/collision/geometry/box"
        return {
            "hip_offset": [ahead * hip[0], left * hip[1]],
            "thigh_offset": left * thigh[1],
            "thigh_length": -knee[2],
            "calf_length": -end[2],
            "foot_radius": self._number(f"{foot}/geometry/sphere", "radius"),
            "thigh_box": self._numbers(thigh_box, "size", 3),
            "calf_box": self._numbers(f"{calf}/geometry/box", "size", 3),
        }

    def _number(self, place: str, attribute: str) -> float:
        return self._numbers(place, attribute, 1)[0]

    def _numbers(self, place: str, attribute: str, count: int) -> list[float]:
        numbers = self._floats(f"{place}, {attribute}", self._text(place, attribute))
        if len(numbers) != count:
            self._refuse(f"{place}, {attribute}, has {len(numbers)} numbers; give {count}")
        return numbers

    def _text(self, place: str, attribute: str) -> str:
        element = self._root.find(place)
        text = None if element is None else element.get(attribute)
        if text is None:
            self._refuse(f"lacks {place}, {attribute}; add it")
        return text

    def _floats(self, what: str, text: str) -> list[float]:
        try:
            return [float(word) for word in text.split()]
        except ValueError:
            self._refuse(f"{what} is {text!r}; give numbers")

    def _refuse(self, problem: str) -> NoReturn:
        raise InputError(f"{self._path}: {problem}")
