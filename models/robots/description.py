"""Writes a robot's URDF of its `robot.yaml`.

The feet are merged into the calves, one body fewer a leg; every shape is a primitive, and looks are
those of one robot, stretched to the sizes of another. The file is kept so that any URDF reader can
open it. A robot may also have a URDF that was written in another way.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from glassgait.models.errors import InputError
from glassgait.models.robots.inertial import Inertial
from glassgait.models.robots.quadruped import AXES, JOINTS, LEGS
from glassgait.models.robots.robot import Robot

WRITTEN = "Written by models/robots/description.py from robot.yaml."
"""What a URDF says that was written here."""

TRUNK_LENGTH, LIMB_LENGTH = 0.267, 0.2
"""Sizes (m) of the robot that the looks were drawn for."""

_BLACK = "0.10 0.10 0.11 1"
_GRAPHITE = "0.22 0.23 0.25 1"
_SILVER = "0.72 0.74 0.76 1"
_LENS = "0.15 0.35 0.55 1"
_RUBBER = "0.05 0.05 0.05 1"
_QUARTER = np.pi / 2

Triple = Sequence[float]


def mirrored(body: Inertial, *, x: bool = False, y: bool = False) -> Inertial:
    """Reflects a body through the plane x = 0, the plane y = 0, or both."""
    sign_x, sign_y = (-1 if x else 1), (-1 if y else 1)
    return Inertial(
        mass=body.mass,
        center=(sign_x * body.center[0], sign_y * body.center[1], body.center[2]),
        ixx=body.ixx,
        ixy=sign_x * sign_y * body.ixy,
        ixz=sign_x * body.ixz,
        iyy=body.iyy,
        iyz=sign_y * body.iyz,
        izz=body.izz,
    )


def merged(first: Inertial, second: Inertial) -> Inertial:
    """Welds two bodies that share a frame into one, by the parallel-axis theorem."""
    mass = first.mass + second.mass
    weights = np.array([first.mass, second.mass]) / mass
    center = weights @ np.array([first.center, second.center])
    inertia = np.zeros((3, 3))
    for body in (first, second):
        arm = np.array(body.center) - center
        inertia += body.matrix + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = inertia.tolist()
    x, y, z = center.tolist()
    return Inertial(mass, (x, y, z), ixx, ixy, ixz, iyy, iyz, izz)


def urdf(robot: Robot) -> str:
    """Returns a robot's description.

    Raises:
        InputError: if an inertia is missing.
    """
    for name in ("trunk", "hip", "thigh", "calf"):
        if name not in robot.inertias:
            raise InputError(f"{robot.path}: key 'inertias' lacks {name!r}; add it")
    body = "\n".join([_trunk(robot), *(_leg(robot, leg) for leg in LEGS)])
    return (
        '<?xml version="1.0"?>\n'
        f"<!-- {robot.full_name}. {WRITTEN} -->\n"
        f'<robot xmlns:drake="http://drake.mit.edu" name="{robot.name}">\n{body}\n</robot>\n'
    )


def _trunk(robot: Robot) -> str:
    looks = _Looks(robot.trunk_box[0] / TRUNK_LENGTH)
    visuals = [
        looks.box((0.25, 0.13, 0.112), _GRAPHITE),
        looks.box((0.267, 0.194, 0.05), _BLACK, (0, 0, -0.012)),
        looks.box((0.27, 0.1, 0.02), _SILVER, (0, 0, 0.052)),
        looks.box((0.24, 0.012, 0.05), _SILVER, (0, 0.096, 0.008)),
        looks.box((0.24, 0.012, 0.05), _SILVER, (0, -0.096, 0.008)),
        # The head: a wedge of two boxes with the depth camera's bar in front.
        looks.box((0.11, 0.11, 0.07), _BLACK, (0.18, 0, 0.01)),
        looks.box((0.05, 0.13, 0.052), _GRAPHITE, (0.235, 0, 0.015), (0, 0.25, 0)),
        looks.box((0.008, 0.09, 0.022), _LENS, (0.262, 0, 0.014), (0, 0.25, 0)),
        looks.box((0.11, 0.1, 0.06), _BLACK, (-0.18, 0, 0.005)),
        looks.cylinder(0.012, 0.11, _SILVER, (0, 0, 0.072), (0, _QUARTER, 0)),
    ]
    return _link("trunk", robot.inertias["trunk"], visuals, [_collision(_box(*robot.trunk_box))])


def _leg(robot: Robot, leg: str) -> str:
    hind, right = leg[0] == "R", leg[1] == "R"
    side = -1 if right else 1
    x, y = robot.hip_offset
    outward, foot = robot.thigh_offset * side, (0, 0, -robot.calf_length)
    inertias = robot.inertias
    calf = inertias["calf"]
    if "foot" in inertias:
        calf = merged(calf, inertias["foot"])
    looks, quarter = _Looks(robot.thigh_length / LIMB_LENGTH), (_QUARTER, 0, 0)
    hip_looks = [
        looks.cylinder(0.046, 0.05, _BLACK, rpy=(0, _QUARTER, 0)),
        _Looks(1.0).cylinder(0.046, 0.04, _SILVER, (0, 0.55 * outward, 0), quarter),
    ]
    thigh_looks = [
        looks.cylinder(0.045, 0.036, _BLACK, rpy=quarter),
        looks.cylinder(0.03, 0.042, _SILVER, rpy=quarter),
        looks.box((0.05, 0.026, 0.1), _GRAPHITE, (-0.004, 0, -0.05)),
        looks.box((0.034, 0.0245, 0.17), _BLACK, (0, 0, -0.105)),
        looks.cylinder(0.019, 0.03, _SILVER, (0, 0, -0.2), quarter),
    ]
    sphere = _sphere(robot.foot_radius)
    calf_looks = [
        looks.capsule(0.0105, 0.16, _GRAPHITE, (0.004, 0, -0.1)),
        _visual(sphere, _RUBBER, foot),
    ]
    calf_shapes = [
        _limb_collision(robot.calf_box, robot.calf_length),
        _collision(sphere, foot, name=f"{leg}_foot"),
    ]
    thigh_shapes = [_limb_collision(robot.thigh_box, robot.thigh_length)]
    parts = [
        _link(f"{leg}_hip", mirrored(inertias["hip"], x=hind, y=right), hip_looks, []),
        _link(f"{leg}_thigh", mirrored(inertias["thigh"], y=right), thigh_looks, thigh_shapes),
        _link(f"{leg}_calf", mirrored(calf, y=right), calf_looks, calf_shapes),
        _joint(robot, f"{leg}_hip", "trunk", (-x if hind else x, y * side, 0)),
        _joint(robot, f"{leg}_thigh", f"{leg}_hip", (0, outward, 0)),
        _joint(robot, f"{leg}_calf", f"{leg}_thigh", (0, 0, -robot.thigh_length)),
    ]
    return "\n".join(parts)


def _link(name: str, inertial: Inertial, visuals: list[str], collisions: list[str]) -> str:
    center = _triple(inertial.center)
    inertia = " ".join(
        f'{key}="{getattr(inertial, key):.10g}"'
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    lines = [
        f'  <link name="{name}">',
        "    <inertial>",
        f'      <origin xyz="{center}"/>',
        f'      <mass value="{inertial.mass:g}"/>',
        f"      <inertia {inertia}/>",
        "    </inertial>",
        *visuals,
        *collisions,
        "  </link>",
    ]
    return "\n".join(lines)


def _joint(robot: Robot, name: str, parent: str, xyz: Triple) -> str:
    index = JOINTS.index(name)
    limits = (
        f'lower="{robot.lower_limits[index]:g}" upper="{robot.upper_limits[index]:g}" '
        f'effort="{robot.effort[index]:g}" velocity="{robot.velocity[index]:g}"'
    )
    return "\n".join(
        [
            f'  <joint name="{name}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{name}"/>',
            f'    <origin xyz="{_triple(xyz)}"/>',
            f'    <axis xyz="{_triple(AXES[name.partition("_")[2]])}"/>',
            f"    <limit {limits}/>",
            "  </joint>",
            f'  <transmission name="{name}">',
            "    <type>transmission_interface/SimpleTransmission</type>",
            f'    <joint name="{name}"/>',
            f'    <actuator name="{name}"/>',
            "  </transmission>",
        ]
    )


@dataclass(frozen=True)
class _Looks:
    """Shapes that are seen, and touch nothing, drawn at a scale."""

    scale: float

    def box(
        self, sizes: Triple, color: str, xyz: Triple = (0, 0, 0), rpy: Triple = (0, 0, 0)
    ) -> str:
        return _visual(_box(*self._scaled(sizes)), color, self._scaled(xyz), rpy)

    def cylinder(
        self,
        radius: float,
        length: float,
        color: str,
        xyz: Triple = (0, 0, 0),
        rpy: Triple = (0, 0, 0),
    ) -> str:
        sizes = self._scaled((radius, length))
        shape = '<cylinder radius="{:g}" length="{:g}"/>'.format(*sizes)
        return _visual(shape, color, self._scaled(xyz), rpy)

    def capsule(self, radius: float, length: float, color: str, xyz: Triple) -> str:
        sizes = self._scaled((radius, length))
        shape = '<drake:capsule radius="{:g}" length="{:g}"/>'.format(*sizes)
        return _visual(shape, color, self._scaled(xyz))

    def _scaled(self, sizes: Triple) -> list[float]:
        return [self.scale * size for size in sizes]


def _visual(shape: str, color: str, xyz: Triple = (0, 0, 0), rpy: Triple = (0, 0, 0)) -> str:
    origin = f'<origin xyz="{_triple(xyz)}" rpy="{_triple(rpy)}"/>'
    material = f'<material><color rgba="{color}"/></material>'
    return f"    <visual>{origin}<geometry>{shape}</geometry>{material}</visual>"


def _collision(shape: str, xyz: Triple = (0, 0, 0), rpy: Triple = (0, 0, 0), name: str = "") -> str:
    named = f' name="{name}"' if name else ""
    origin = f'<origin xyz="{_triple(xyz)}" rpy="{_triple(rpy)}"/>'
    return f"    <collision{named}>{origin}<geometry>{shape}</geometry></collision>"


def _limb_collision(box: Triple, length: float) -> str:
    return _collision(_box(*box), (0, 0, -0.5 * length), (0, _QUARTER, 0))


def _box(x: float, y: float, z: float) -> str:
    return f'<box size="{x:g} {y:g} {z:g}"/>'


def _sphere(radius: float) -> str:
    return f'<sphere radius="{radius:g}"/>'


def _triple(values: Triple) -> str:
    # A product with -1 or 0 may be -0.
    return " ".join(f"{value + 0.0:.10g}" for value in values)
