"""Reads a quadruped's sizes, masses and limits from its URDF.

The URDF has to name links, joints and feet as `quadruped` lays them out, and its legs have to be
mirror images of each other.
"""

import math
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.files import read_text
from glassgait.models.robots.quadruped import AXES, JOINTS, LEG_JOINTS, LEGS

LARGEST = 10_000_000
"""Greatest size of a URDF (bytes)."""

TOLERANCE = 1e-6
"""Greatest difference between legs (m); a URDF holds some six digits."""


def read_urdf(path: Path) -> dict[str, Any]:
    """Reads the fields of a robot that its URDF holds.

    Raises:
        InputError: if the file cannot be read or describes another kind of robot.
    """
    return _Urdf(path).fields()


class _Urdf:
    """A parsed URDF."""

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
