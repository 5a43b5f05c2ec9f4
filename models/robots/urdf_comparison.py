"""Compares a robot's URDF with its `robot.yaml`."""

import math
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.files import read_text
from glassgait.models.robots.quadruped import AXES, JOINTS, LEG_JOINTS, LEGS
from glassgait.models.robots.robot import Robot

LARGEST_DESCRIPTION = 10_000_000
"""Greatest size of a URDF (bytes)."""

TOLERANCE = 1e-6
"""Greatest difference of a number in both files; a URDF holds some six digits."""

MASS_TOLERANCE = 1e-3
"""Greatest difference of the robot's mass (kg)."""


def compare_urdf(robot: Robot) -> None:
    """Compares a robot's URDF with its own file.

    Raises:
        InputError: if the URDF cannot be read, or differs; the message names both files and the
            key of the first difference.
    """
    _Comparison(robot).compare()


class _Comparison:
    """A robot's URDF beside its own file; each method refuses what differs."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        try:
            self.root = ElementTree.fromstring(read_text(robot.urdf_path, LARGEST_DESCRIPTION))
        except ElementTree.ParseError as error:
            raise InputError(f"{robot.urdf_path}: is no URDF ({error}); write one") from error

    def compare(self) -> None:
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
