"""The URDF of a robot: its sizes and limits, and the description that both simulators read.

Links that are fixed to each other become one, with the mass, the centre and the inertia of all.
Drake and MuJoCo read the same thirteen links, so that neither makes masses of shapes.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, brief
from glassgait.models.files import read_text
from glassgait.models.robots.quadruped import AXES, JOINTS, LEG_JOINTS, LEGS

LARGEST = 10_000_000  # greatest size of a URDF (bytes)
TOLERANCE = 1e-6  # greatest difference between legs (m); a URDF holds some six digits
LIGHTEST, LEAST_MOMENT = 1e-4, 1e-10  # of a link that moves (kg, kg·m²)
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MOTOR = """<transmission name="{0}"><type>transmission_interface/SimpleTransmission</type>
<joint name="{0}"/><actuator name="{0}"/></transmission>"""

# Drake's own elements keep the prefix that its parser looks for.
ElementTree.register_namespace("drake", "http://drake.mit.edu")


class Urdf:
    """A parsed URDF, whose joints go by the names that are given for each leg."""

    def __init__(self, path: Path, joints: Mapping[str, Sequence[str]]) -> None:
        self._path = path
        try:
            self._root = ElementTree.fromstring(read_text(path, LARGEST))
        except ElementTree.ParseError as error:
            raise InputError(f"{path}: is not a URDF ({error}); mend it") from error
        self._wholes = {part: whole for whole in self._root.iter() for part in whole}
        self._links, found = self._by_name("link"), self._by_name("joint")

        # The twelve joints, by our names, and the thirteen links that move.
        names = dict(zip(JOINTS, (name for leg in LEGS for name in joints[leg]), strict=True))
        self._fixed = [own for own in found.values() if own.get("type") == "fixed"]
        moving = [name for name, own in found.items() if own not in self._fixed]
        if sorted(moving) != sorted(names.values()):
            self._refuse(
                f"its moving joints are {brief(', '.join(moving)) or 'none'}; name hip, thigh and "
                "calf of each leg in robot.yaml by the key 'joints', and fix all others"
            )
        self._joints = {own: found[name] for own, name in names.items()}
        self._bodies = {"trunk": self._text(self._joints["FL_hip"], "parent", "link")}
        for own, joint in self._joints.items():
            self._bodies[own] = self._text(joint, "child", "link")
            before = "trunk" if own.endswith("hip") else JOINTS[JOINTS.index(own) - 1]
            if self._text(joint, "parent", "link") != self._bodies[before]:
                self._refuse(
                    f"{self._called(joint)} does not hang from link {self._bodies[before]}; mend "
                    "the order of 'joints' in robot.yaml"
                )
        self._merge()

    def fields(self) -> dict[str, Any]:
        """Returns the fields of a robot that its URDF holds."""
        # Sizes of the front left leg, which the other legs have to share.
        first, *others = [self._leg(leg) for leg in LEGS]
        for leg, other in zip(LEGS[1:], others, strict=True):
            for key, value in other.items():
                if not np.allclose(value, first[key], rtol=0.0, atol=TOLERANCE):
                    self._refuse(
                        f"{key} of {leg} is {value}, and that of FL is {first[key]}; make the legs "
                        "mirror images of each other"
                    )
        lower, upper, effort, velocity = (
            [self._numbers(joint, "limit", key)[0] for joint in self._joints.values()]
            for key in ("lower", "upper", "effort", "velocity")
        )
        return {
            "mass": self._mass,
            "trunk_box": self._box("trunk"),
            **first,
            "position_limits": [*zip(lower, upper, strict=True)],
            "effort_limits": effort,
            "velocity_limits": velocity,
            "urdf": self._written(),
        }

    def _leg(self, leg: str) -> dict[str, Any]:
        """Returns the sizes of a leg, mirrored to those of the front left one."""
        # Places of joints and foot, each in the frame of the link before.
        places = []
        for kind in LEG_JOINTS:
            joint = self._joints[f"{leg}_{kind}"]
            if joint.get("type") != "revolute":
                self._refuse(f"{self._called(joint)} is not revolute; give it this type and limits")
            if self._numbers(joint, "axis", "xyz", 3) != list(AXES[kind]):
                self._refuse(
                    f"the axis of {self._called(joint)} is not {AXES[kind]}; turn its frame"
                )
            pose = self._pose(joint)
            if np.abs(pose[:3, :3] - np.eye(3)).max() > TOLERANCE:
                self._refuse(f"the origin of {self._called(joint)} has an rpy; give it none")
            places.append(pose[:3, 3].tolist())
        link = self._links[self._bodies[f"{leg}_calf"]]
        shapes = link.findall("collision")
        spheres = [own for own in shapes if own.find("geometry/sphere") is not None]
        if len(spheres) != 1:
            self._refuse(f"{self._called(link)} has {len(spheres)} collision spheres; give it one")
        spheres[0].set("name", f"{leg}_foot")
        (hip, thigh, knee), foot = places, self._pose(spheres[0])[:3, 3].tolist()
        if max(map(abs, (hip[2], thigh[0], thigh[2], *knee[:2], *foot[:2]))) > TOLERANCE:
            self._refuse(
                f"leg {leg} does not hang straight down at angles 0, from a hip joint as high as "
                "the trunk's centre; move its joints' origins"
            )
        ahead, left = (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)
        return {
            "hip_offset": [ahead * hip[0], left * hip[1]],
            "thigh_offset": left * thigh[1],
            "thigh_length": -knee[2],
            "calf_length": -foot[2],
            "foot_radius": self._numbers(spheres[0], "geometry/sphere", "radius")[0],
            "thigh_box": self._box(f"{leg}_thigh")[::-1],
            "calf_box": self._box(f"{leg}_calf")[::-1],
        }

    def _box(self, body: str) -> list[float]:
        """Returns sizes (3; m), along the link's axes, of its first collision box."""
        link = self._links[self._bodies[body]]
        for own in link.iterfind("collision"):
            if own.find("geometry/box") is not None:
                size = self._numbers(own, "geometry/box", "size", 3)
                # Rounded, since right angles are written with ten digits.
                return np.round(np.abs(self._pose(own)[:3, :3]) @ size, 9).tolist()
        self._refuse(f"{self._called(link)} has no collision box; give it one")

    def _merge(self) -> None:
        """Moves shapes and inertia of fixed links to the links that move."""
        masses, left = [], set(self._links)
        for body in self._bodies.values():
            parts, link = self._parts(body), self._links[body]
            if twice := {*parts} - left:
                self._refuse(f"link {min(twice)} is fixed to two moving links; leave one joint")
            left -= {*parts}
            whole = np.zeros((4, 4))
            for name, pose in parts.items():
                inertia = self._inertia(self._links[name])
                masses.append(float(inertia[3, 3]))
                whole += pose @ inertia @ pose.T
                for shape in self._links[name].findall("*") if name != body else ():
                    if shape.tag in ("collision", "visual"):
                        _write_pose(shape, pose @ self._pose(shape))
                        link.append(shape)
            self._set_inertia(link, whole, written=len(parts) == 1)
            self._check_shapes(link)
        if left:
            self._refuse(f"link {min(left)} is not joined to the robot; remove it")
        self._mass = math.fsum(masses)

    def _set_inertia(self, link: Element, whole: Array, *, written: bool) -> None:
        """Gives a link its inertia (see `_inertia`), unless it is written there, digit by digit."""
        mass = float(whole[3, 3])
        centre = whole[:3, 3] / (mass or 1.0)
        spread = whole[:3, :3] - mass * np.outer(centre, centre)
        moments = np.trace(spread) * np.eye(3) - spread
        low, middle, high = np.linalg.eigvalsh(moments)
        # Of no body is one moment of inertia above the sum of the others.
        possible = high <= (low + middle) * (1.0 + TOLERANCE)
        if mass < LIGHTEST or low < LEAST_MOMENT or not possible:
            self._refuse(
                f"{self._called(link)} moves with {mass:g} kg and principal moments of inertia of "
                f"{low:.3g}, {middle:.3g} and {high:.3g} kg·m², as no body does; mend its inertial"
            )
        if not written:
            _write_inertial(link, mass, centre, moments)

    def _parts(self, body: str) -> dict[str, Array]:
        """Returns the poses (4, 4) of the links that are fixed to a body, itself first."""
        parts, waiting = {body: np.eye(4)}, [body]
        for name in waiting:
            if name not in self._links:
                self._refuse(f"lacks link {name!r}, which a joint names; add it")
            for joint in self._fixed:
                ends = [self._text(joint, end, "link") for end in ("parent", "child")]
                for (near, far), turn in ((ends, np.asarray), (ends[::-1], np.linalg.inv)):
                    if near == name and far not in parts:
                        parts[far] = parts[name] @ turn(self._pose(joint))
                        waiting.append(far)
        return parts

    def _inertia(self, link: Element) -> Array:
        """Returns mass, first and second moments of a link in its frame (4, 4)."""
        inertia, own = np.zeros((4, 4)), link.find("inertial")
        if own is None:
            return inertia
        (inertia[3, 3],) = self._numbers(own, "mass", "value")
        if not 0.0 <= inertia[3, 3] <= 1000.0:
            self._refuse(
                f"{self._called(link)} has {inertia[3, 3]:g} kg; give it a mass from 0 to 1000 kg"
            )
        if own.find("inertia") is not None:
            xx, xy, xz, yy, yz, zz = (self._numbers(own, "inertia", key)[0] for key in MOMENTS)
            moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            inertia[:3, :3] = 0.5 * np.trace(moments) * np.eye(3) - moments
        pose = self._pose(own)
        return pose @ inertia @ pose.T

    def _check_shapes(self, link: Element) -> None:
        """Refuses what does not collide alike in both simulators, and drops meshes of looks."""
        for own in link.iterfind("*/geometry/*"):
            for key in own.attrib if own.tag != "mesh" else ():
                if min(self._numbers(own, ".", key, 3 if key == "size" else 1)) <= 0.0:
                    self._refuse(
                        f"{key} of {self._called(own)} is {own.get(key)}; give more than 0"
                    )
        for shape in link.findall("collision"):
            shape.attrib.pop("name", None)
            kinds = [own.tag for own in shape.iterfind("geometry/*")]
            if kinds not in (["box"], ["sphere"], ["cylinder"]):
                self._refuse(
                    f"{self._called(link)} collides by {brief(' '.join(kinds)) or 'nothing'}; give "
                    "a box, a sphere or a cylinder"
                )
        for look in link.findall("visual"):
            if look.find("geometry/mesh") is not None:
                link.remove(look)
        if link.find("visual") is None:
            for shape in link.findall("collision"):
                ElementTree.SubElement(link, "visual").extend(list(shape))

    def _written(self) -> str:
        """Returns the description that both simulators read."""
        robot = Element("robot", name=self._root.get("name", "robot"))
        names = {link: own for own, link in self._bodies.items()}
        for link, own in names.items():
            self._links[link].set("name", own)
        robot.extend([*self._root.iterfind("material"), self._links[self._bodies["trunk"]]])
        for leg in LEGS:
            joints = {own: self._joints[own] for own in JOINTS if own.startswith(leg)}
            robot.extend(self._links[self._bodies[own]] for own in joints)
            for own, joint in joints.items():
                joint.set("name", own)
                for part in list(joint):
                    if part.tag in ("parent", "child"):
                        part.set("link", names[part.get("link", "")])
                    elif part.tag not in ("origin", "axis", "limit"):
                        # Drake knows no joint's friction, which MuJoCo would read.
                        joint.remove(part)
                robot.extend([joint, ElementTree.fromstring(MOTOR.format(own))])
        return ElementTree.tostring(robot, encoding="unicode")

    def _pose(self, element: Element) -> Array:
        """Returns the pose (4, 4) that an element's origin gives, or none."""
        pose, origin = np.eye(4), element.find("origin")
        said = {} if origin is None else origin.attrib
        if "xyz" in said:
            pose[:3, 3] = self._numbers(element, "origin", "xyz", 3)
        if "rpy" in said:
            angles = self._numbers(element, "origin", "rpy", 3)
            pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        return pose

    def _numbers(self, element: Element, part: str, key: str, count: int = 1) -> list[float]:
        text = self._text(element, part, key)
        try:
            numbers = [float(word) for word in text.split() if word.isascii()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not all(abs(number) <= 1e6 for number in numbers):
            found = element.find(part)
            assert found is not None
            self._refuse(
                f"{key} of {self._called(found)} is {brief(text)!r}; give {count} number"
                f"{'s' * (count > 1)} of at most 1e6"
            )
        return numbers

    def _text(self, element: Element, part: str, key: str) -> str:
        found = element.find(part)
        text = None if found is None else found.get(key)
        if text is None:
            self._refuse(f"{self._called(element)} lacks {part} {key}; add it")
        return text

    def _by_name(self, kind: str) -> dict[str, Element]:
        found: dict[str, Element] = {}
        for element in self._root.iterfind(kind):
            name = element.get("name")
            if not name or name in found:
                self._refuse(f"{kind} name {name!r} is none or given twice; give each {kind} one")
            found[name] = element
        return found

    def _called(self, element: Element) -> str:
        if element.tag in ("link", "joint"):
            return f"{element.tag} {element.get('name')}"
        return f"{element.tag} of {self._called(self._wholes[element])}"

    def _refuse(self, problem: str) -> NoReturn:
        raise InputError(f"{self._path}: {problem}")


def _write_pose(element: Element, pose: Array) -> None:
    for old in element.findall("origin"):
        element.remove(old)
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True)
    said = {"xyz": pose[:3, 3], "rpy": angles}
    words = {key: " ".join(map(repr, numbers.tolist())) for key, numbers in said.items()}
    element.insert(0, Element("origin", words))


def _write_inertial(link: Element, mass: float, centre: Array, moments: Array) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    own = ElementTree.SubElement(link, "inertial")
    own.append(Element("origin", xyz=" ".join(map(repr, centre.tolist()))))
    own.append(Element("mass", value=repr(mass)))
    upper = moments[np.triu_indices(3)].tolist()
    own.append(Element("inertia", dict(zip(MOMENTS, map(repr, upper), strict=True))))
