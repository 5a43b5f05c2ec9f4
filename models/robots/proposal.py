"""Writes a `robot.yaml` of what a description says, with proposals where it is silent.

A stance and gains stand in no description. They are proposed from those of the robot that is meant
where none is named, stretched to other lengths and weights. What a robot must have and the
description lacks is left open, and the file is refused until a person fills it in.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.robots.description import mirrored
from glassgait.models.robots.found_robot import FoundLeg, FoundRobot
from glassgait.models.robots.inertial import Inertial
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.quadruped import LEG_JOINTS, LEGS

MOMENTS = tuple(key for key in Inertial.__dataclass_fields__ if key.startswith("i"))
"""Keys of an inertia's moments."""

SAME = 5e-4
"""Greatest difference of limits that are written as one (rad, N·m, rad/s)."""

LEAST_OF_LIMB = 0.8
"""Least share of a limb's length that a found box must cover to be taken for the limb's."""

KNEE_FORWARD = 0.05
"""Middle of a calf's range beyond which its knee is taken to point forward (rad)."""

FOOT_SHARE = 0.05
"""Radius of a foot that is not found, over the length of the leg."""

Source = Literal["found", "proposed", "missing"]


@dataclass(frozen=True)
class Entry:
    """A key of a robot's file.

    Attributes:
        key: The key.
        value: Its value as YAML has it, empty where it is missing.
        source: Where the value is from.
        comment: Its unit, or what it is.
    """

    key: str
    value: str
    source: Source
    comment: str


def propose(found: FoundRobot, name: str) -> list[Entry]:
    """Returns all entries of the file of a robot, in order.

    Args:
        found: What its description says.
        name: The robot's name.
    """
    return _Proposal(found, name).entries()


def robot_text(found: FoundRobot, entries: list[Entry]) -> str:
    """Returns the text of a `robot.yaml`, of which comments say where each value is from."""
    lines = [
        f"# Read from {json.dumps(found.path.name)}. Joints are of that file's names, axes and zero"
        " angles: ours = sign · theirs + offset (rad)",
    ]
    for leg, own in found.legs.items():
        for part, joint in enumerate(LEG_JOINTS):
            sign, offset = own.sign[part], own.offset[part] + 0.0
            theirs = json.dumps(own.joints[part])
            lines.append(f"#   {leg}_{joint} = {sign:+.0f} · {theirs} {offset:+.4f}")
    for entry in entries:
        comment = entry.comment if entry.source == "found" else f"{entry.source}; {entry.comment}"
        first, *others = f"{entry.key}: {entry.value}".splitlines()
        lines += [f"{first.rstrip()}  # {comment}", *others]
    return "\n".join(lines) + "\n"


class _Proposal:
    """What is written of a robot, and why."""

    def __init__(self, found: FoundRobot, name: str) -> None:
        self._found, self._name = found, name
        self._leg = found.legs["FL"]
        self._length = self._leg.thigh_length + self._leg.calf_length
        self._parts = [mean_of_legs(found, part) for part in range(len(LEG_JOINTS))]
        self._mass = found.trunk_inertia.mass + len(LEGS) * sum(own.mass for own in self._parts)
        self._model = load_robot()
        self._model_length = self._model.thigh_length + self._model.calf_length

    def entries(self) -> list[Entry]:
        leg, found = self._leg, self._found
        return [
            Entry("name", self._name, "found", "letters, digits and _"),
            Entry("full_name", json.dumps(found.name or self._name), "found", "as it is called"),
            Entry("description", f"{self._name}.urdf", "found", "written beside this file"),
            Entry("mass", f"{self._mass:.7g}", "found", "kg"),
            Entry("hip_offset", _listed(leg.hip[:2]), "found", "m, along x and along y"),
            Entry("thigh_offset", _number(leg.outward), "found", "m, from a hip joint outward"),
            Entry("thigh_length", _number(leg.thigh_length), "found", "m"),
            Entry("calf_length", _number(leg.calf_length), "found", "m, to the foot's centre"),
            self._foot_radius(),
            *self._boxes(),
            self._limits("position_limits", "rad", lambda own: own.limits),
            self._limits("effort_limits", "N·m", lambda own: own.effort),
            self._limits("velocity_limits", "rad/s", lambda own: own.velocity),
            Entry("stance", _mapping(self._stance(), _listed), "proposed", "rad: hip, thigh, calf"),
            *self._gains(),
            Entry("motor_order", self._motor_order(), "proposed", "as the file orders its legs"),
            Entry("inertias", self._inertias(), "found", "kg, m, kg·m²; legs: their mean, as FL"),
        ]

    def _foot_radius(self) -> Entry:
        found = self._leg.foot_radius
        radius = FOOT_SHARE * self._length if found is None else found
        return Entry("foot_radius", _number(radius), _source(found), "m")

    def _boxes(self) -> list[Entry]:
        model, stretch = self._model, self._length / self._model_length
        x, y = self._leg.hip[:2] / np.array(model.hip_offset) * model.trunk_box[:2]
        entries = [self._box("trunk", self._found.trunk_box, (x, y, stretch * model.trunk_box[2]))]
        limbs = {
            "thigh": (self._leg.thigh_length, model.thigh_box),
            "calf": (self._leg.calf_length, model.calf_box),
        }
        for (part, (length, box)), found in zip(limbs.items(), self._found.limb_boxes, strict=True):
            covers = found is not None and found[0] >= LEAST_OF_LIMB * length
            proposed = (length, *(stretch * size for size in box[1:]))
            entries.append(self._box(part, found if covers else None, proposed))
        return entries

    def _box(self, part: str, found: tuple[float, ...] | None, proposed: Any) -> Entry:
        sizes = proposed if found is None else found
        along = "x, y and z" if part == "trunk" else "along the limb, across, third"
        return Entry(f"{part}_box", _listed(sizes), _source(found), f"m, {along}")

    def _limits(self, key: str, unit: str, of: Callable[[FoundLeg], Array]) -> Entry:
        """Returns limits by kind of joint where those of all legs are alike, else by joint."""
        found = np.array([of(self._found.legs[leg]) for leg in LEGS])
        values: dict[str, Any] = {}
        for part, kind in enumerate(LEG_JOINTS):
            own = found[:, part]
            if np.isnan(own).any():
                values[kind] = None
            elif np.ptp(own, axis=0).max() < SAME:
                values[kind] = own[0]
            else:
                values |= {f"{leg}_{kind}": own[i] for i, leg in enumerate(LEGS)}
        missing = any(value is None for value in values.values())

        def text(value: Any) -> str:
            return "" if value is None else _listed(value) if np.ndim(value) else _number(value)

        return Entry(key, _mapping(values, text), "missing" if missing else "found", unit)

    def _stance(self) -> dict[str, Array]:
        """Returns angles that put each foot where the model's is, over the length of the leg."""
        model = self._model
        upper, lower = model.thigh_length, model.calf_length
        stance = {}
        for leg, own in self._found.legs.items():
            hip, thigh, calf = model.stance[leg]
            ahead = -upper * np.sin(thigh) - lower * np.sin(thigh + calf)
            down = upper * np.cos(thigh) + lower * np.cos(thigh + calf)
            stretch = self._length / self._model_length
            # A knee that may bend either way bends backward.
            bends_back = not own.limits[2].mean() > KNEE_FORWARD
            side = 1.0 if bends_back else -1.0
            angles = _reach(own, side * stretch * ahead, stretch * down, side)
            limits = np.where(np.isnan(own.limits), [-np.inf, np.inf], own.limits)
            stance[leg] = np.clip(np.round([hip, *angles], 2), limits[:, 0], limits[:, 1])
        return stance

    def _gains(self) -> list[Entry]:
        model, length = self._model, self._length / self._model_length
        mass = self._mass / model.mass
        # The stance sags by as many degrees, and swings as far beyond.
        stiffness = model.stiffness * mass * length
        damping = model.damping * np.sqrt(mass * length * mass * length**2)
        return [
            Entry("stiffness", _number(float(f"{stiffness:.2g}")), "proposed", "N·m/rad"),
            Entry("damping", _number(float(f"{damping:.2g}")), "proposed", "N·m·s/rad"),
            Entry("action_scale", f"{model.action_scale:g}", "proposed", "rad for an action of 1"),
        ]

    def _motor_order(self) -> str:
        return f"[{', '.join(self._found.order)}]"

    def _inertias(self) -> str:
        bodies = {"trunk": self._found.trunk_inertia}
        bodies |= dict(zip(LEG_JOINTS, self._parts, strict=True))
        lines = []
        for name, body in bodies.items():
            center = _listed(body.center)
            moments = ", ".join(f"{key}: {_number(getattr(body, key))}" for key in MOMENTS)
            lines.append(f"\n  {name}: {{mass: {body.mass:.7g}, center: {center},\n    {moments}}}")
        return "".join(lines)


def mean_of_legs(found: FoundRobot, part: int) -> Inertial:
    """Returns the mean inertia of hip, thigh or calf over the legs, each seen as the front left."""
    bodies = [
        mirrored(leg.inertias[part], x=part == 0 and name[0] == "R", y=name[1] == "R")
        for name, leg in found.legs.items()
    ]
    mass = np.mean([body.mass for body in bodies])
    x, y, z = np.mean([body.mass * np.array(body.center) for body in bodies], axis=0) / mass
    moments = {key: float(np.mean([getattr(body, key) for body in bodies])) for key in MOMENTS}
    return Inertial(float(mass), (float(x), float(y), float(z)), **moments)


def _reach(leg: FoundLeg, ahead: float, down: float, side: float) -> tuple[float, float]:
    """Returns thigh and calf angle (rad) that put a foot there, the knee behind for side 1."""
    upper, lower = leg.thigh_length, leg.calf_length
    far = np.clip(np.hypot(ahead, down), abs(upper - lower) + 1e-6, upper + lower - 1e-6)
    at_hip = np.arccos((upper**2 + far**2 - lower**2) / (2.0 * upper * far))
    at_knee = np.arccos((upper**2 + lower**2 - far**2) / (2.0 * upper * lower))
    return float(np.arctan2(-ahead, down) + side * at_hip), float(-side * (np.pi - at_knee))


def _source(found: object) -> Source:
    return "proposed" if found is None else "found"


def _number(value: float) -> str:
    text = f"{value + 0.0:.6g}"
    # YAML takes 6e-06 for text.
    return text if "e" not in text or "." in text else text.replace("e", ".0e")


def _listed(values: Any) -> str:
    return f"[{', '.join(_number(round(float(value), 9)) for value in values)}]"


def _mapping(values: Mapping[str, Any], text: Callable[[Any], str]) -> str:
    return f"{{{', '.join(f'{key}: {text(value)}'.rstrip() for key, value in values.items())}}}"
