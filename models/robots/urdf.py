"""The URDF of a robot: its sizes and limits, and the description that both simulators read.

What is welded together becomes one link, with the mass, the centre and the inertia of all its
parts. Drake and MuJoCo then read the same thirteen links, each with its inertia, so that neither
makes a mass of a shape or drops one.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, brief
from glassgait.models.files import read_text
from glassgait.models.robots.quadruped import AXES, JOINTS, LEG_JOINTS, LEGS

LARGEST = 10_000_000  # greatest size of a URDF (bytes)
TOLERANCE = 1e-6  # greatest difference between legs (m); a URDF holds some six digits
LIGHTEST, LEAST_INERTIA = 1e-4, 1e-10  # of a link that moves (kg, kg·m²)
MESHES = (".obj", ".gltf", ".glb", ".vtk")  # kinds of meshes that Drake draws

# Drake's own elements keep the prefix that its parser looks for.
ElementTree.register_namespace("drake", "http://drake.mit.edu")


class _Pose(NamedTuple):
    rotation: Array
    place: Array

    def of(self, other: "_Pose") -> "_Pose":
        return _Pose(self.rotation @ other.rotation, self.place + self.rotation @ other.place)

    def inverse(self) -> "_Pose":
        return _Pose(self.rotation.T, -self.rotation.T @ self.place)


class _Inertia(NamedTuple):
    mass: float
    centre: Array
    moments: Array  # about the centre (3, 3)


HERE = _Pose(np.eye(3), np.zeros(3))


def read_urdf(path: Path, joints: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Returns the fields of a robot that its URDF holds, from the joints' names by leg."""
    return _Urdf(path, joints).fields()


class _Urdf:
    """A parsed URDF, rewritten with one link for each body and our names of joints and links."""

    def __init__(self, path: Path, joints: Mapping[str, Sequence[str]]) -> None:
        self._path = path
        try:
            self._root = ElementTree.fromstring(read_text(path, LARGEST))
        except ElementTree.ParseError as error:
            raise InputError(f"{path}: is not a URDF ({error}); mend it") from error
        self._parents = {part: whole for whole in self._root.iter() for part in whole}
        self._links, found = self._by_name("link"), self._by_name("joint")

        # The twelve joints and the thirteen links that they move, by our names.
        names = dict(zip(JOINTS, (name for leg in LEGS for name in joints[leg]), strict=True))
        moving = [name for name, joint in found.items() if joint.get("type") != "fixed"]
        if sorted(moving) != sorted(names.values()):
            self._refuse(
                f"its moving joints are {brief(', '.join(moving)) or 'none'}; name hip, thigh and "
                "calf of each leg in robot.yaml by the key 'joints', and fix all others"
            )
        self._joints = {own: found[name] for own, name in names.items()}
        self._fixed = [joint for joint in found.values() if joint.get("type") == "fixed"]
        self._bodies = {"trunk": self._text(self._joints["FL_hip"], "parent", "link")}
        for own, joint in self._joints.items():
            self._bodies[own] = self._text(joint, "child", "link")
        for own, joint in self._joints.items():
            before = "trunk" if own.endswith("hip") else JOINTS[JOINTS.index(own) - 1]
            if self._text(joint, "parent", "link") != self._bodies[before]:
                self._refuse(
                    f"{self._called(joint)} does not hang from link {self._bodies[before]}"
                )
        self._merge()

    def fields(self) -> dict[str, Any]:
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
            key: [self._numbers(joint, "limit", key, 1)[0] for joint in self._joints.values()]
            for key in ("lower", "upper", "effort", "velocity")
        }
        return {
            "mass": self._mass,
            "trunk_box": self._box("trunk").tolist(),
            **first,
            "position_limits": [*zip(limits["lower"], limits["upper"], strict=True)],
            "effort_limits": limits["effort"],
            "velocity_limits": limits["velocity"],
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
            if np.abs(pose.rotation - np.eye(3)).max() > TOLERANCE:
                self._refuse(f"the origin of {self._called(joint)} has an rpy; give it none")
            places.append(pose.place.tolist())
        (hip, thigh, knee), (foot, radius) = places, self._foot(leg)
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
            "foot_radius": radius,
            "thigh_box": self._box(f"{leg}_thigh")[::-1].tolist(),
            "calf_box": self._box(f"{leg}_calf")[::-1].tolist(),
        }

    def _foot(self, leg: str) -> tuple[list[float], float]:
        """Returns centre and radius of the sphere at the end of a calf, and names it."""
        link = self._links[self._bodies[f"{leg}_calf"]]
        spheres = [
            own for own in link.iterfind("collision") if own.find("geometry/sphere") is not None
        ]
        if len(spheres) != 1:
            self._refuse(
                f"{self._called(link)} has {len(spheres)} collision spheres; give it one, the foot"
            )
        spheres[0].set("name", f"{leg}_foot")
        (radius,) = self._numbers(spheres[0], "geometry/sphere", "radius", 1)
        return self._pose(spheres[0]).place.tolist(), radius

    def _box(self, body: str) -> Array:
        """Returns sizes (3; m), along the link's axes, of its first box or cylinder."""
        link = self._links[self._bodies[body]]
        for own in link.iterfind("collision"):
            if own.find("geometry/box") is not None:
                size = self._numbers(own, "geometry/box", "size", 3)
            elif own.find("geometry/cylinder") is not None:
                radius, length = (
                    self._numbers(own, "geometry/cylinder", key, 1)[0]
                    for key in ("radius", "length")
                )
                size = [2.0 * radius, 2.0 * radius, length]
            else:
                continue
            # Rounded, since right angles are written with ten digits.
            return np.round(np.abs(self._pose(own).rotation) @ size, 9)
        self._refuse(f"{self._called(link)} has no collision box or cylinder; give it one")

    def _merge(self) -> None:
        """Gives each body what is welded to it."""
        masses, left = [], dict(self._links)
        for body in self._bodies.values():
            parts = self._parts(body)
            if twice := {*parts} - {*left}:
                self._refuse(f"link {min(twice)} is fixed to two links; leave one joint")
            link, inertias = self._links[body], []
            for name, pose in parts.items():
                inertia = self._inertia(left.pop(name))
                masses.append(inertia.mass)
                turn = pose.rotation
                centre = pose.place + turn @ inertia.centre
                inertias.append(_Inertia(inertia.mass, centre, turn @ inertia.moments @ turn.T))
                if name != body:
                    self._take_shapes(link, self._links[name], pose)
            whole = _sum(inertias)
            low, middle, high = np.linalg.eigvalsh(whole.moments)
            # No body has a moment above the sum of the two others.
            possible = low >= LEAST_INERTIA and high <= (low + middle) * (1.0 + 1e-6)
            if whole.mass < LIGHTEST or not possible:
                self._refuse(
                    f"{self._called(link)} moves with {whole.mass:g} kg and principal moments of "
                    f"inertia of {low:.3g}, {middle:.3g} and {high:.3g} kg·m², as no body does; "
                    "mend its inertial"
                )
            if len(parts) > 1:
                _write_inertia(link, whole)
            self._tidy(link)
        if left:
            self._refuse(f"link {min(left)} is not joined to the robot; remove it")
        self._mass = math.fsum(masses)

    def _parts(self, body: str) -> dict[str, _Pose]:
        """Returns where the links stand that are welded to a body, itself first."""
        parts, waiting = {body: HERE}, [body]
        while waiting:
            name = waiting.pop()
            if name not in self._links:
                self._refuse(f"lacks link {name!r}, which a joint names; add it")
            for joint in self._fixed:
                ends = [self._text(joint, end, "link") for end in ("parent", "child")]
                if name not in ends:
                    continue
                pose = self._pose(joint) if name == ends[0] else self._pose(joint).inverse()
                other = ends[1] if name == ends[0] else ends[0]
                if other not in parts:
                    parts[other] = parts[name].of(pose)
                    waiting.append(other)
        return parts

    def _inertia(self, link: Element) -> _Inertia:
        """Returns a link's inertia in its frame; without an inertial it has none."""
        own = link.find("inertial")
        if own is None:
            return _Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
        (mass,) = self._numbers(own, "mass", "value", 1)
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        has = own.find("inertia") is not None
        xx, xy, xz, yy, yz, zz = (
            self._numbers(own, "inertia", key, 1)[0] if has else 0.0 for key in keys
        )
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if not 0.0 <= mass <= 1000.0:
            self._refuse(
                f"{self._called(link)} has a mass of {mass:g} kg; give it one from 0 to 1000 kg"
            )
        pose = self._pose(own)
        return _Inertia(mass, pose.place, pose.rotation @ moments @ pose.rotation.T)

    def _take_shapes(self, link: Element, part: Element, pose: _Pose) -> None:
        """Moves shapes and looks of a welded part to the link that carries it."""
        for shape in [*part.iterfind("visual"), *part.iterfind("collision")]:
            _write_pose(shape, pose.of(self._pose(shape)))
            link.append(shape)

    def _tidy(self, link: Element) -> None:
        """Drops names of shapes and looks that cannot be drawn; refuses meshes that collide."""
        for shape in link.findall("collision"):
            shape.attrib.pop("name", None)
            kinds = [own.tag for own in shape.iterfind("geometry/*")]
            if len(kinds) != 1 or kinds[0] not in ("box", "sphere", "cylinder"):
                self._refuse(
                    f"{self._called(link)} collides by {brief(' '.join(kinds)) or 'nothing'}; give "
                    "a box, a sphere or a cylinder"
                )
        for own in link.iterfind("*/geometry/*"):
            for key in own.attrib if own.tag != "mesh" else ():
                if min(self._numbers(own, ".", key, 3 if key == "size" else 1)) <= 0.0:
                    self._refuse(
                        f"{key} of {self._called(own)} is {own.get(key)}; give more than 0"
                    )
        for shape in link.findall("visual"):
            mesh = shape.find("geometry/mesh")
            file = None if mesh is None else self._mesh(mesh.get("filename", ""))
            if mesh is not None and file is None:
                link.remove(shape)
            elif mesh is not None:
                mesh.set("filename", str(file))
        if link.find("visual") is None:
            for shape in link.findall("collision"):
                look = ElementTree.SubElement(link, "visual")
                look.extend(own for own in shape if own.tag in ("origin", "geometry"))

    def _mesh(self, name: str) -> Path | None:
        """Returns the file of a mesh that Drake draws, if it is found."""
        file = self._path.parent / name.removeprefix("file://")
        if name.startswith("package://"):
            package, _, rest = name.removeprefix("package://").partition("/")
            folders = (up for up in self._path.resolve().parents if up.name == package)
            file = next(folders, Path(package)) / rest
        return file.resolve() if file.suffix.lower() in MESHES and file.is_file() else None

    def _written(self) -> str:
        """Returns the description that both simulators read."""
        robot = Element("robot", name=self._root.get("name", "robot"))
        robot.extend(self._root.iterfind("material"))
        names = {link: own for own, link in self._bodies.items()}
        for link, own in names.items():
            self._links[link].set("name", own)
        robot.append(self._links[self._bodies["trunk"]])
        for leg in LEGS:
            joints = {own: self._joints[own] for own in JOINTS if own.startswith(leg)}
            robot.extend(self._links[self._bodies[own]] for own in joints)
            for own, joint in joints.items():
                joint.set("name", own)
                for part in list(joint):
                    if part.tag in ("parent", "child"):
                        part.set("link", names[part.get("link", "")])
                    elif part.tag not in ("origin", "axis", "limit"):
                        # Of friction and damping each simulator reads others.
                        joint.remove(part)
                robot.append(joint)
                motor = ElementTree.SubElement(robot, "transmission", name=own)
                kind = ElementTree.SubElement(motor, "type")
                kind.text = "transmission_interface/SimpleTransmission"
                ElementTree.SubElement(motor, "joint", name=own)
                ElementTree.SubElement(motor, "actuator", name=own)
        return ElementTree.tostring(robot, encoding="unicode")

    def _pose(self, element: Element) -> _Pose:
        origin = element.find("origin")
        said = {} if origin is None else origin.attrib
        roll, pitch, yaw, *place = (
            number
            for key in ("rpy", "xyz")
            for number in (self._numbers(element, "origin", key, 3) if key in said else [0.0] * 3)
        )
        (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
        rotation = np.array(
            [
                [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                [-sp, cp * sr, cp * cr],
            ]
        )
        return _Pose(rotation, np.array(place))

    def _numbers(self, element: Element, part: str, attribute: str, count: int) -> list[float]:
        found, text = element.find(part), self._text(element, part, attribute)
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        sound = len(numbers) == count and text.isascii()
        if not (sound and all(abs(number) <= 1e6 for number in numbers)):
            where = self._called(element if found is None else found)
            self._refuse(
                f"{attribute} of {where} is {brief(text)!r}; give {count} number"
                f"{'s' * (count > 1)} of at most 1e6"
            )
        return numbers

    def _text(self, element: Element, part: str, attribute: str) -> str:
        found = element.find(part)
        text = None if found is None else found.get(attribute)
        if text is None:
            self._refuse(f"{self._called(element)} lacks {part} {attribute}; add it")
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
        whole = self._parents.get(element)
        if element.tag == "geometry" and whole is not None:
            return self._called(whole)
        return element.tag if whole is None else f"{element.tag} of {self._called(whole)}"

    def _refuse(self, problem: str) -> NoReturn:
        raise InputError(f"{self._path}: {problem}")


def _sum(parts: Sequence[_Inertia]) -> _Inertia:
    """Adds up inertias that are expressed in one frame."""
    mass = math.fsum(part.mass for part in parts)
    centre = sum((part.mass * part.centre for part in parts), np.zeros(3)) / (mass or 1.0)
    moments = np.zeros((3, 3))
    for part in parts:
        away = part.centre - centre
        squares = away @ away * np.eye(3) - np.outer(away, away)
        moments += part.moments + part.mass * squares
    return _Inertia(mass, centre, moments)


def _write_pose(element: Element, pose: _Pose) -> None:
    for old in element.findall("origin"):
        element.remove(old)
    r = pose.rotation
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    if math.hypot(r[0, 0], r[1, 0]) > 1e-9:
        roll, yaw = math.atan2(r[2, 1], r[2, 2]), math.atan2(r[1, 0], r[0, 0])
    else:
        # Straight up or down only the sum of the other two counts.
        roll, yaw = 0.0, math.atan2(-r[0, 1], r[1, 1])
    said = {"xyz": pose.place.tolist(), "rpy": [roll, pitch, yaw]}
    words = {key: " ".join(map(repr, numbers)) for key, numbers in said.items()}
    element.insert(0, Element("origin", words))


def _write_inertia(link: Element, inertia: _Inertia) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    own = ElementTree.SubElement(link, "inertial")
    _write_pose(own, _Pose(np.eye(3), inertia.centre))
    ElementTree.SubElement(own, "mass", value=repr(inertia.mass))
    axes, moments = "xyz", inertia.moments.tolist()
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    words = {f"i{axes[i]}{axes[j]}": repr(moments[i][j]) for i, j in pairs}
    ElementTree.SubElement(own, "inertia", words)
