"""Reads a robot's URDF, and rewrites it for Drake and MuJoCo with one link for each moving body.

Links that are fixed to each other become one, with the mass, the centre and the inertia of all.
Both simulators read the same thirteen links, so that neither derives masses from shapes.
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
TOLERANCE = 1e-6  # greatest difference between legs (m); URDFs have about six digits
LIGHTEST, LEAST_MOMENT = 1e-4, 1e-10  # of a link that moves (kg, kg·m²)
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MOTOR = """<transmission name="{0}"><type>transmission_interface/SimpleTransmission</type>
<joint name="{0}"/><actuator name="{0}"/></transmission>"""

# Drake's parser expects this prefix of its extensions.
ElementTree.register_namespace("drake", "http://drake.mit.edu")


class Urdf:
    """A parsed URDF; `joints` gives the names of its hip, thigh and calf joints by leg."""

    def __init__(self, path: Path, joints: Mapping[str, Sequence[str]]) -> None:
        self._path = path
        try:
            self._root = ElementTree.fromstring(read_text(path, LARGEST))
        except ElementTree.ParseError as error:
            raise InputError(f"{path}: is not a URDF ({error}); correct it") from error
        self._parents = {child: parent for parent in self._root.iter() for child in parent}
        self._links, elements = self._by_name("link"), self._by_name("joint")

        # The twelve joints, by our names, and the thirteen links that move.
        names = dict(zip(JOINTS, (name for leg in LEGS for name in joints[leg]), strict=True))
        self._fixed = [element for element in elements.values() if element.get("type") == "fixed"]
        moving = [name for name, element in elements.items() if element not in self._fixed]
        if sorted(moving) != sorted(names.values()):
            self._refuse(
                f"its moving joints are {brief(', '.join(moving)) or 'none'}; name hip, thigh and "
                "calf of each leg in robot.yaml by the key 'joints', and fix all others"
            )
        self._joints = {name: elements[names[name]] for name in JOINTS}
        self._bodies = {"trunk": self._text(self._joints["FL_hip"], "parent", "link")}
        for name, joint in self._joints.items():
            self._bodies[name] = self._text(joint, "child", "link")
            parent = "trunk" if name.endswith("hip") else JOINTS[JOINTS.index(name) - 1]
            if self._text(joint, "parent", "link") != self._bodies[parent]:
                self._refuse(
                    f"{self._label(joint)} does not hang from link {self._bodies[parent]}; correct "
                    "the order of 'joints' in robot.yaml"
                )
        self._merge()

    def fields(self) -> dict[str, Any]:
        """Returns the fields of a `Robot` that are read from the URDF."""
        # Sizes of the front left leg; those of the other legs must be equal.
        first, *others = [self._leg(leg) for leg in LEGS]
        for leg, other in zip(LEGS[1:], others, strict=True):
            for key, value in other.items():
                if not np.allclose(value, first[key], rtol=0.0, atol=TOLERANCE):
                    self._refuse(
                        f"{key} of {leg} is {value}, but {first[key]} of FL; make all legs alike"
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
            "urdf": self._rewritten(),
        }

    def _leg(self, leg: str) -> dict[str, Any]:
        """Returns the sizes of a leg, mirrored to the front left one."""
        # Positions of joints and foot, each in the frame of its parent link.
        positions = []
        for kind in LEG_JOINTS:
            joint = self._joints[f"{leg}_{kind}"]
            if joint.get("type") != "revolute":
                self._refuse(f"{self._label(joint)} is not revolute; give it this type and limits")
            if self._numbers(joint, "axis", "xyz", 3) != list(AXES[kind]):
                self._refuse(
                    f"the axis of {self._label(joint)} is not {AXES[kind]}; turn its frame"
                )
            pose = self._pose(joint)
            if np.abs(pose[:3, :3] - np.eye(3)).max() > TOLERANCE:
                self._refuse(f"the origin of {self._label(joint)} has an rpy; remove it")
            positions.append(pose[:3, 3].tolist())
        link = self._links[self._bodies[f"{leg}_calf"]]
        shapes = link.findall("collision")
        spheres = [shape for shape in shapes if shape.find("geometry/sphere") is not None]
        if len(spheres) != 1:
            self._refuse(f"{self._label(link)} has {len(spheres)} collision spheres; give it one")
        spheres[0].set("name", f"{leg}_foot")
        (hip, thigh, knee), foot = positions, self._pose(spheres[0])[:3, 3].tolist()
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
        """Returns the sizes of a link's first collision box along the link's axes (3; m)."""
        link = self._links[self._bodies[body]]
        for shape in link.iterfind("collision"):
            if shape.find("geometry/box") is not None:
                size = self._numbers(shape, "geometry/box", "size", 3)
                # Rounded, because URDFs write right angles with ten digits.
                return np.round(np.abs(self._pose(shape)[:3, :3]) @ size, 9).tolist()
        self._refuse(f"{self._label(link)} has no collision box; give it one")

    def _merge(self) -> None:
        """Moves shapes and inertia of fixed links to the links that move."""
        masses, unused = [], set(self._links)
        for body in self._bodies.values():
            poses, link = self._fixed_to(body), self._links[body]
            if twice := {*poses} - unused:
                self._refuse(f"link {min(twice)} is fixed to two moving links; leave one joint")
            unused -= {*poses}
            total = np.zeros((4, 4))
            for name, pose in poses.items():
                inertia = self._inertia(self._links[name])
                masses.append(float(inertia[3, 3]))
                total += pose @ inertia @ pose.T
                for shape in self._links[name].findall("*") if name != body else ():
                    if shape.tag in ("collision", "visual"):
                        _write_pose(shape, pose @ self._pose(shape))
                        link.append(shape)
            self._set_inertia(link, total, unchanged=len(poses) == 1)
            self._check_shapes(link)
        if unused:
            self._refuse(f"link {min(unused)} is not joined to the robot; remove it")
        self._mass = math.fsum(masses)

    def _set_inertia(self, link: Element, total: Array, *, unchanged: bool) -> None:
        """Checks a link's inertia (see `_inertia`), and writes it if it is not `unchanged`."""
        mass = float(total[3, 3])
        centre = total[:3, 3] / (mass or 1.0)
        spread = total[:3, :3] - mass * np.outer(centre, centre)
        moments = np.trace(spread) * np.eye(3) - spread
        low, middle, high = np.linalg.eigvalsh(moments)
        # No body has a moment of inertia above the sum of the two others.
        possible = high <= (low + middle) * (1.0 + TOLERANCE)
        if mass < LIGHTEST or low < LEAST_MOMENT or not possible:
            self._refuse(
                f"{self._label(link)} has {mass:g} kg and principal moments of inertia {low:.3g}, "
                f"{middle:.3g} and {high:.3g} kg·m², which no moving body has; correct its inertial"
            )
        if not unchanged:
            _write_inertial(link, mass, centre, moments)

    def _fixed_to(self, body: str) -> dict[str, Array]:
        """Returns the poses (4, 4) of the links that are fixed to a body, itself first."""
        poses, queue = {body: np.eye(4)}, [body]
        for name in queue:
            if name not in self._links:
                self._refuse(f"lacks link {name!r}, which a joint names; add it")
            for joint in self._fixed:
                ends = [self._text(joint, end, "link") for end in ("parent", "child")]
                for (near, far), turn in ((ends, np.asarray), (ends[::-1], np.linalg.inv)):
                    if near == name and far not in poses:
                        poses[far] = poses[name] @ turn(self._pose(joint))
                        queue.append(far)
        return poses

    def _inertia(self, link: Element) -> Array:
        """Returns the mass, first and second moments of a link in its frame (4, 4)."""
        inertia, inertial = np.zeros((4, 4)), link.find("inertial")
        if inertial is None:
            return inertia
        (inertia[3, 3],) = self._numbers(inertial, "mass", "value")
        if not 0.0 <= inertia[3, 3] <= 1000.0:
            self._refuse(
                f"{self._label(link)} has {inertia[3, 3]:g} kg; give it a mass from 0 to 1000 kg"
            )
        if inertial.find("inertia") is not None:
            xx, xy, xz, yy, yz, zz = (self._numbers(inertial, "inertia", key)[0] for key in MOMENTS)
            moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            inertia[:3, :3] = 0.5 * np.trace(moments) * np.eye(3) - moments
        pose = self._pose(inertial)
        return pose @ inertia @ pose.T

    def _check_shapes(self, link: Element) -> None:
        """Refuses shapes that the simulators collide differently, and removes visual meshes."""
        for shape in link.iterfind("*/geometry/*"):
            for key in shape.attrib if shape.tag != "mesh" else ():
                if min(self._numbers(shape, ".", key, 3 if key == "size" else 1)) <= 0.0:
                    self._refuse(
                        f"{key} of {self._label(shape)} is {shape.get(key)}; give more than 0"
                    )
        for shape in link.findall("collision"):
            shape.attrib.pop("name", None)
            kinds = [geometry.tag for geometry in shape.iterfind("geometry/*")]
            if kinds not in (["box"], ["sphere"], ["cylinder"]):
                self._refuse(
                    f"{self._label(link)} collides by {brief(' '.join(kinds)) or 'nothing'}; give "
                    "a box, a sphere or a cylinder"
                )
        for visual in link.findall("visual"):
            if visual.find("geometry/mesh") is not None:
                link.remove(visual)
        if link.find("visual") is None:
            for shape in link.findall("collision"):
                ElementTree.SubElement(link, "visual").extend(list(shape))

    def _rewritten(self) -> str:
        """Returns the URDF for both simulators, with our names of links and joints."""
        robot = Element("robot", name=self._root.get("name", "robot"))
        names = {link: name for name, link in self._bodies.items()}
        for link, name in names.items():
            self._links[link].set("name", name)
        robot.extend([*self._root.iterfind("material"), self._links[self._bodies["trunk"]]])
        for leg in LEGS:
            joints = {name: self._joints[name] for name in JOINTS if name.startswith(leg)}
            robot.extend(self._links[self._bodies[name]] for name in joints)
            for name, joint in joints.items():
                joint.set("name", name)
                for child in list(joint):
                    if child.tag in ("parent", "child"):
                        child.set("link", names[child.get("link", "")])
                    elif child.tag not in ("origin", "axis", "limit"):
                        # MuJoCo would read joint friction, which Drake ignores.
                        joint.remove(child)
                robot.extend([joint, ElementTree.fromstring(MOTOR.format(name))])
        return ElementTree.tostring(robot, encoding="unicode")

    def _pose(self, element: Element) -> Array:
        """Returns the pose (4, 4) of an element's origin, by default the identity."""
        pose, origin = np.eye(4), element.find("origin")
        attributes = {} if origin is None else origin.attrib
        if "xyz" in attributes:
            pose[:3, 3] = self._numbers(element, "origin", "xyz", 3)
        if "rpy" in attributes:
            angles = self._numbers(element, "origin", "rpy", 3)
            pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
        return pose

    def _numbers(self, element: Element, path: str, key: str, count: int = 1) -> list[float]:
        text = self._text(element, path, key)
        try:
            numbers = [float(word) for word in text.split() if word.isascii()]
        except ValueError:
            numbers = []
        if len(numbers) != count or not all(abs(number) <= 1e6 for number in numbers):
            child = element.find(path)
            assert child is not None
            self._refuse(
                f"{key} of {self._label(child)} is {brief(text)!r}; give {count} number"
                f"{'s' * (count > 1)} of at most 1e6"
            )
        return numbers

    def _text(self, element: Element, path: str, key: str) -> str:
        child = element.find(path)
        text = None if child is None else child.get(key)
        if text is None:
            self._refuse(f"{self._label(element)} lacks {path} {key}; add it")
        return text

    def _by_name(self, kind: str) -> dict[str, Element]:
        elements: dict[str, Element] = {}
        for element in self._root.iterfind(kind):
            name = element.get("name")
            if not name or name in elements:
                self._refuse(f"{kind} name {name!r} is missing or not unique; give each {kind} one")
            elements[name] = element
        return elements

    def _label(self, element: Element) -> str:
        if element.tag in ("link", "joint"):
            return f"{element.tag} {element.get('name')}"
        return f"{element.tag} of {self._label(self._parents[element])}"

    def _refuse(self, problem: str) -> NoReturn:
        raise InputError(f"{self._path}: {problem}")


def _write_pose(element: Element, pose: Array) -> None:
    for old in element.findall("origin"):
        element.remove(old)
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", suppress_warnings=True)
    origin = {"xyz": pose[:3, 3], "rpy": angles}
    texts = {key: " ".join(map(repr, numbers.tolist())) for key, numbers in origin.items()}
    element.insert(0, Element("origin", texts))


def _write_inertial(link: Element, mass: float, centre: Array, moments: Array) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ElementTree.SubElement(link, "inertial")
    inertial.append(Element("origin", xyz=" ".join(map(repr, centre.tolist()))))
    inertial.append(Element("mass", value=repr(mass)))
    upper = moments[np.triu_indices(3)].tolist()
    inertial.append(Element("inertia", dict(zip(MOMENTS, map(repr, upper), strict=True))))
