"""Writes the A1's URDF from the vendor's inertial table.

`python -m glassgait.models.robots.description` does it. The feet are merged into the calves, one
body fewer a leg; every shape is a primitive. The file is kept beside this module so that any URDF
reader can open it, and a test holds the two together.
"""

from dataclasses import dataclass

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped, robot

ROBOT_NAME = "a1"

_BLACK = "0.10 0.10 0.11 1"
_GRAPHITE = "0.22 0.23 0.25 1"
_SILVER = "0.72 0.74 0.76 1"
_LENS = "0.15 0.35 0.55 1"
_RUBBER = "0.05 0.05 0.05 1"


@dataclass(frozen=True)
class Inertial:
    """Mass (kg), centre of mass (m) and inertia about it (kg·m²) of a body, in the body's axes."""

    mass: float
    center: tuple[float, float, float]
    ixx: float
    ixy: float
    ixz: float
    iyy: float
    iyz: float
    izz: float

    def mirrored(self, *, x: bool = False, y: bool = False) -> "Inertial":
        """Reflects the body through the plane x = 0, the plane y = 0, or both."""
        sign_x, sign_y = (-1 if x else 1), (-1 if y else 1)
        center = (sign_x * self.center[0], sign_y * self.center[1], self.center[2])
        return Inertial(
            mass=self.mass,
            center=center,
            ixx=self.ixx,
            ixy=sign_x * sign_y * self.ixy,
            ixz=sign_x * self.ixz,
            iyy=self.iyy,
            iyz=sign_y * self.iyz,
            izz=self.izz,
        )

    def matrix(self) -> Array:
        """Returns the inertia about the centre of mass (3, 3)."""
        return np.array(
            [
                [self.ixx, self.ixy, self.ixz],
                [self.ixy, self.iyy, self.iyz],
                [self.ixz, self.iyz, self.izz],
            ]
        )


TRUNK = Inertial(
    6.0, (0.0, 0.0041, -0.0005), 0.0158533, -3.66e-5, -6.11e-5, 0.0377999, -2.75e-5, 0.0456542
)
HIP = Inertial(
    0.595,
    (-0.003875, 0.001622, 0.000042),
    4.02747e-4,
    -8.709e-6,
    -2.97e-7,
    6.91123e-4,
    -5.45e-7,
    4.87919e-4,
)
THIGH = Inertial(
    0.888,
    (-0.003574, -0.019529, -0.030323),
    0.005251806,
    -2.168e-6,
    3.46889e-4,
    0.005000475,
    -2.8174e-5,
    0.00111020,
)
CALF = Inertial(
    0.151,
    (0.007105, -0.000239, -0.096933),
    0.002344758,
    0.0,
    -1.41275e-4,
    0.002360755,
    0.0,
    3.1158e-5,
)
FOOT = Inertial(0.06, (0.0, 0.0, -robot.CALF_LENGTH), 9.6e-6, 0.0, 0.0, 9.6e-6, 0.0, 9.6e-6)


def merged(first: Inertial, second: Inertial) -> Inertial:
    """Welds two bodies that share a frame into one, by the parallel-axis theorem."""
    mass = first.mass + second.mass
    weights = np.array([first.mass, second.mass]) / mass
    center = weights @ np.array([first.center, second.center])
    inertia = np.zeros((3, 3))
    for body in (first, second):
        arm = np.array(body.center) - center
        inertia += body.matrix() + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Inertial(
        mass=mass,
        center=(float(center[0]), float(center[1]), float(center[2])),
        ixx=inertia[0, 0],
        ixy=inertia[0, 1],
        ixz=inertia[0, 2],
        iyy=inertia[1, 1],
        iyz=inertia[1, 2],
        izz=inertia[2, 2],
    )


def urdf() -> str:
    """Returns the robot's description."""
    parts = [_trunk()]
    for leg in quadruped.LEGS:
        parts.append(_leg(leg))
    body = "\n".join(parts)
    return (
        '<?xml version="1.0"?>\n'
        "<!-- Unitree A1. Written by models/robots/description.py; change it there. -->\n"
        f'<robot xmlns:drake="http://drake.mit.edu" name="{ROBOT_NAME}">\n{body}\n</robot>\n'
    )


def _trunk() -> str:
    visuals = [
        _visual(_box(0.25, 0.13, 0.112), _GRAPHITE, xyz=(0, 0, 0)),
        _visual(_box(0.267, 0.194, 0.05), _BLACK, xyz=(0, 0, -0.012)),
        _visual(_box(0.27, 0.1, 0.02), _SILVER, xyz=(0, 0, 0.052)),
        _visual(_box(0.24, 0.012, 0.05), _SILVER, xyz=(0, 0.096, 0.008)),
        _visual(_box(0.24, 0.012, 0.05), _SILVER, xyz=(0, -0.096, 0.008)),
        # The head: a wedge of two boxes with the depth camera's bar in front.
        _visual(_box(0.11, 0.11, 0.07), _BLACK, xyz=(0.18, 0, 0.01)),
        _visual(_box(0.05, 0.13, 0.052), _GRAPHITE, xyz=(0.235, 0, 0.015), rpy=(0, 0.25, 0)),
        _visual(_box(0.008, 0.09, 0.022), _LENS, xyz=(0.262, 0, 0.014), rpy=(0, 0.25, 0)),
        _visual(_box(0.11, 0.1, 0.06), _BLACK, xyz=(-0.18, 0, 0.005)),
        _visual(_cylinder(0.012, 0.11), _SILVER, xyz=(0.0, 0.0, 0.072), rpy=(0, np.pi / 2, 0)),
    ]
    collision = _collision(_box(*robot.TRUNK_BOX))
    return _link("trunk", TRUNK, visuals, [collision])


def _leg(leg: str) -> str:
    hind, right = leg[0] == "R", leg[1] == "R"
    side = -1 if right else 1
    hip_xyz = (
        robot.HIP_OFFSET_X * (-1 if hind else 1),
        robot.HIP_OFFSET_Y * side,
        0,
    )
    calf = merged(CALF, FOOT)
    outward = robot.THIGH_OFFSET_Y * side
    quarter = np.pi / 2
    hip_visuals = [
        _visual(_cylinder(0.046, 0.05), _BLACK, rpy=(0, quarter, 0)),
        _visual(_cylinder(0.046, 0.04), _SILVER, xyz=(0, 0.55 * outward, 0), rpy=(quarter, 0, 0)),
    ]
    thigh_visuals = [
        _visual(_cylinder(0.045, 0.036), _BLACK, rpy=(quarter, 0, 0)),
        _visual(_cylinder(0.03, 0.042), _SILVER, rpy=(quarter, 0, 0)),
        _visual(_box(0.05, 0.026, 0.1), _GRAPHITE, xyz=(-0.004, 0, -0.05)),
        _visual(_box(0.034, 0.0245, 0.17), _BLACK, xyz=(0, 0, -0.105)),
        _visual(_cylinder(0.019, 0.03), _SILVER, xyz=(0, 0, -0.2), rpy=(quarter, 0, 0)),
    ]
    calf_visuals = [
        _visual(_capsule(0.0105, 0.16), _GRAPHITE, xyz=(0.004, 0, -0.1)),
        _visual(_sphere(robot.FOOT_RADIUS), _RUBBER, xyz=(0, 0, -robot.CALF_LENGTH)),
    ]
    links = [
        _link(f"{leg}_hip", HIP.mirrored(x=hind, y=right), hip_visuals, []),
        _link(
            f"{leg}_thigh",
            THIGH.mirrored(y=right),
            thigh_visuals,
            [_limb_collision(robot.THIGH_BOX, robot.THIGH_LENGTH)],
        ),
        _link(
            f"{leg}_calf",
            calf.mirrored(y=right),
            calf_visuals,
            [
                _limb_collision(robot.CALF_BOX, robot.CALF_LENGTH),
                _collision(
                    _sphere(robot.FOOT_RADIUS),
                    xyz=(0, 0, -robot.CALF_LENGTH),
                    name=f"{leg}_foot",
                ),
            ],
        ),
    ]
    joints = [
        _joint(leg, "hip", "trunk", hip_xyz, "1 0 0"),
        _joint(leg, "thigh", f"{leg}_hip", (0, outward, 0), "0 1 0"),
        _joint(leg, "calf", f"{leg}_thigh", (0, 0, -robot.THIGH_LENGTH), "0 1 0"),
    ]
    return "\n".join(links + joints)


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


def _joint(leg: str, kind: str, parent: str, xyz: tuple[float, float, float], axis: str) -> str:
    name = f"{leg}_{kind}"
    lower, upper = robot.POSITION_LIMITS[kind]
    limits = (
        f'lower="{lower:g}" upper="{upper:g}" '
        f'effort="{robot.EFFORT_LIMIT:g}" velocity="{robot.VELOCITY_LIMIT:g}"'
    )
    return "\n".join(
        [
            f'  <joint name="{name}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{name}"/>',
            f'    <origin xyz="{_triple(xyz)}"/>',
            f'    <axis xyz="{axis}"/>',
            f"    <limit {limits}/>",
            "  </joint>",
            f'  <transmission name="{name}">',
            "    <type>transmission_interface/SimpleTransmission</type>",
            f'    <joint name="{name}"/>',
            f'    <actuator name="{name}"/>',
            "  </transmission>",
        ]
    )


def _visual(shape: str, color: str, xyz: tuple = (0, 0, 0), rpy: tuple = (0, 0, 0)) -> str:
    origin = f'<origin xyz="{_triple(xyz)}" rpy="{_triple(rpy)}"/>'
    material = f'<material><color rgba="{color}"/></material>'
    return f"    <visual>{origin}<geometry>{shape}</geometry>{material}</visual>"


def _collision(shape: str, xyz: tuple = (0, 0, 0), rpy: tuple = (0, 0, 0), name: str = "") -> str:
    named = f' name="{name}"' if name else ""
    origin = f'<origin xyz="{_triple(xyz)}" rpy="{_triple(rpy)}"/>'
    return f"    <collision{named}>{origin}<geometry>{shape}</geometry></collision>"


def _limb_collision(box: tuple[float, float, float], length: float) -> str:
    return _collision(_box(*box), xyz=(0, 0, -0.5 * length), rpy=(0, np.pi / 2, 0))


def _box(x: float, y: float, z: float) -> str:
    return f'<box size="{x:g} {y:g} {z:g}"/>'


def _sphere(radius: float) -> str:
    return f'<sphere radius="{radius:g}"/>'


def _cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{radius:g}" length="{length:g}"/>'


def _capsule(radius: float, length: float) -> str:
    return f'<drake:capsule radius="{radius:g}" length="{length:g}"/>'


def _triple(values: tuple) -> str:
    return " ".join(f"{value:.10g}" for value in values)


if __name__ == "__main__":
    robot.URDF_PATH.write_text(urdf())
