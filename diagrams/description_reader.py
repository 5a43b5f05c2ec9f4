"""Reads a quadruped's numbers from a description that another project wrote, in URDF or MJCF.

Names, axes and zero angles of such a file are its own. Here legs are named by where they are,
and joints by their order along the leg; angles are turned so that a leg hangs straight down at 0
and each axis points as this project's does. MuJoCo parses both formats.
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.files import read_text
from glassgait.models.robots.description import merged
from glassgait.models.robots.found_robot import FoundLeg, FoundRobot
from glassgait.models.robots.inertial import Inertial
from glassgait.models.robots.quadruped import AXES, LEG_JOINTS, LEGS
from glassgait.models.robots.urdf_comparison import LARGEST_DESCRIPTION

FORMATS = (".urdf", ".xml", ".mjcf")
"""Extensions of descriptions that are read."""

TRUNK = 0
"""What is welded to the trunk is, to MuJoCo, welded to the body of this number."""

STRAIGHT = 1e-3
"""Greatest sine of the angle between an axis of the file and one of ours."""

AXIS_PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")

NOTHING = 0.01
"""Greatest mass of a link without a sound inertia that is taken for a frame (kg)."""

ALIKE = 1e-3
"""Greatest difference between lengths of the four legs (m)."""


def read_description(path: Path) -> FoundRobot:
    """Reads a quadruped's numbers.

    Args:
        path: A URDF, or an MJCF.

    Raises:
        InputError: if it cannot be read, is of no quadruped with legs of three joints, or its legs
            move otherwise than by one axis along x and two along y; the message names what.
    """
    spec = parse_description(path)
    return _Reader(path, spec).robot()


def parse_description(path: Path) -> mujoco.MjSpec:
    """Parses a URDF or an MJCF without its meshes; what is welded stays a body of its own.

    Shapes without a name get one, and the first body's frame is where the world's is.

    Raises:
        InputError: if it cannot be read.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"{path}: ends in none of {', '.join(FORMATS)}; give a URDF or an MJCF")
    text = read_text(path, LARGEST_DESCRIPTION)
    try:
        root = ElementTree.fromstring(text)
        if root.tag == "robot":
            _drop_what_has_no_part(root)
            spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
        else:
            # Files that it includes stand beside it.
            spec = mujoco.MjSpec.from_file(str(path))
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"{path}: is no URDF or MJCF that MuJoCo reads ({error})") from error
    mesh = mujoco.mjtGeom.mjGEOM_MESH
    for shape in [shape for shape in spec.geoms if shape.type == mesh]:
        spec.delete(shape)
    for part in [*spec.meshes, *spec.keys]:
        spec.delete(part)
    trunk = spec.worldbody.first_body()
    if trunk is None:
        raise InputError(f"{path}: has no body; give the description of a quadruped")
    trunk.pos, trunk.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    trunk.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.compiler.fusestatic = False
    for number, shape in enumerate(spec.geoms):
        shape.name = shape.name or f"shape_{number}"
    return spec


def _drop_what_has_no_part(root: ElementTree.Element) -> None:
    """Removes looks and meshes of a URDF, and inertias that none has, of links that are frames."""
    for link in root.iter("link"):
        meshes = [own for own in link.findall("collision") if own.find("geometry/mesh") is not None]
        for shape in [*link.findall("visual"), *meshes]:
            link.remove(shape)
        inertial = link.find("inertial")
        if inertial is not None and _is_nothing(inertial):
            link.remove(inertial)


def _is_nothing(inertial: ElementTree.Element) -> bool:
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None or float(mass.get("value", "0")) > NOTHING:
        return False
    xx, xy, xz, yy, yz, zz = (float(inertia.get(f"i{own}", "0")) for own in AXIS_PAIRS)
    return bool(np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0] < 1e-12)


class _Reader:
    """A compiled description, and what is asked of it."""

    def __init__(self, path: Path, spec: mujoco.MjSpec) -> None:
        self._path, self._spec = path, spec
        # The trunk is held: it needs no mass of its own then, as the first link of many a URDF has
        # none.
        trunk = spec.worldbody.first_body()
        for joint in list(trunk.joints):
            spec.delete(joint)
        self._name = trunk.name
        try:
            self._model = spec.compile()
        except ValueError as error:
            raise InputError(f"{path}: MuJoCo refuses it ({error}); mend the file") from error
        self._data = mujoco.MjData(self._model)
        root = self._model.body(self._name).id
        self._own = self._model.body_rootid == root
        self._data.qpos[:] = 0.0
        mujoco.mj_kinematics(self._model, self._data)

    def robot(self) -> FoundRobot:
        chains = self._chains()
        anchors = np.array([self._data.xanchor[chain] for chain in chains])
        thighs = anchors[:, 1]
        hips = np.stack([thighs[:, 0], anchors[:, 0, 1], anchors[:, 0, 2]], axis=1)
        middle = hips.mean(axis=0)
        legs = {}
        for chain, hip in zip(chains, hips - middle, strict=True):
            leg = ("F" if hip[0] > 0.0 else "R") + ("L" if hip[1] > 0.0 else "R")
            if leg in legs:
                self._refuse(f"two legs are {leg}", "x points ahead and y to the left")
            legs[leg] = self._leg(leg, chain, hip)
        order, legs = tuple(legs), {leg: legs[leg] for leg in LEGS}
        self._compare(legs)
        return FoundRobot(
            path=self._path,
            name=self._spec.modelname,
            trunk=self._name,
            middle=middle,
            mass=float(self._model.body_mass[self._own].sum()),
            trunk_inertia=self._inertia(TRUNK, np.eye(3), middle),
            trunk_box=self._box(TRUNK, np.eye(3)),
            limb_boxes=self._limb_boxes(legs["FL"]),
            legs=legs,
            order=order,
        )

    def _chains(self) -> list[list[int]]:
        """Returns the joints of each leg, from the trunk on."""
        model = self._model
        hinge = mujoco.mjtJoint.mjJNT_HINGE
        moving = [joint for joint in range(model.njnt) if self._own[model.jnt_bodyid[joint]]]
        for joint in moving:
            if model.jnt_type[joint] != hinge:
                self._refuse(
                    f"joint {model.joint(joint).name} does not turn about one axis",
                    "all joints of a robot do",
                )
        before = {
            joint: model.body_weldid[model.body_parentid[model.jnt_bodyid[joint]]]
            for joint in moving
        }
        starts = [joint for joint in moving if before[joint] == TRUNK]
        chains = []
        for start in starts:
            chain = [start]
            while after := [
                joint for joint in moving if before[joint] == model.jnt_bodyid[chain[-1]]
            ]:
                if len(after) > 1:
                    self._refuse(f"{model.joint(chain[-1]).name} branches", "a leg is one chain")
                chain += after
            chains.append(chain)
        if [len(chain) for chain in chains] != [len(LEG_JOINTS)] * len(LEGS):
            lengths = ", ".join(str(len(chain)) for chain in chains) or "none"
            self._refuse(
                f"chains of joints have lengths {lengths}",
                f"a robot has {len(LEGS)} legs of {len(LEG_JOINTS)} joints, and no other joints",
            )
        return chains

    def _leg(self, leg: str, chain: list[int], hip: Array) -> FoundLeg:
        model, data = self._model, self._data
        signs = [self._sign(joint, kind) for joint, kind in zip(chain, LEG_JOINTS, strict=True)]
        bodies = [int(model.jnt_bodyid[joint]) for joint in chain]
        anchor = data.xanchor[chain]
        foot, end, shape = self._foot(bodies[-1])
        if abs(anchor[1, 2] - anchor[0, 2]) > ALIKE:
            self._refuse(
                f"the thigh joint of {leg} is {anchor[1, 2] - anchor[0, 2]:+.4f} m above its hip "
                "joint at angles 0",
                "it must be beside it",
            )
        thigh_turn, thigh_length = _hanging(anchor[2] - anchor[1])
        calf_turn, calf_length = _hanging(foot - anchor[2])
        sign = np.array(signs)
        offset = np.array([0.0, thigh_turn, calf_turn - thigh_turn])
        # Axes along y may be anywhere on it: all are put where the foot is, and no lengths change.
        plane = [0.0, foot[1], 0.0]
        origins = [
            np.array([anchor[1, 0], anchor[0, 1], anchor[0, 2]]),
            anchor[1] * [1.0, 0.0, 1.0] + plane,
            anchor[2] * [1.0, 0.0, 1.0] + plane,
        ]
        turns = [np.eye(3), _about_y(-thigh_turn), _about_y(-calf_turn)]
        return FoundLeg(
            joints=tuple(model.joint(joint).name for joint in chain),
            bodies=tuple(model.body(body).name for body in bodies),
            hip=hip,
            outward=float(foot[1] - anchor[0, 1]),
            thigh_length=thigh_length,
            calf_length=calf_length,
            foot_body=model.body(end).name,
            foot="" if shape is None else model.geom(shape).name,
            foot_radius=None if shape is None else float(model.geom_size[shape, 0]),
            sign=sign,
            offset=offset,
            limits=self._limits(chain, sign, offset),
            effort=np.array([self._effort(joint) for joint in chain]),
            velocity=self._velocities(chain),
            inertias=tuple(
                self._inertia(body, turn, origin)
                for body, turn, origin in zip(bodies, turns, origins, strict=True)
            ),
        )

    def _sign(self, joint: int, kind: str) -> float:
        axis, ours = self._data.xaxis[joint], np.array(AXES[kind])
        if np.linalg.norm(np.cross(axis, ours)) > STRAIGHT:
            name, shown = self._model.joint(joint).name, np.round(axis, 4).tolist()
            self._refuse(
                f"joint {name} turns about {shown} at angles 0",
                f"a {kind} turns about {list(AXES[kind])} or the contrary",
            )
        return float(np.sign(axis @ ours))

    def _foot(self, calf: int) -> tuple[Array, int, int | None]:
        """Returns the foot's centre at angles 0 of the file (3; m), its body and its sphere."""
        model, data = self._model, self._data
        sphere = mujoco.mjtGeom.mjGEOM_SPHERE
        welded = [body for body in range(model.nbody) if model.body_weldid[body] == calf]
        spheres = [
            geom
            for geom in range(model.ngeom)
            if model.geom_type[geom] == sphere and model.geom_bodyid[geom] in welded
        ]
        knee = data.xpos[calf]
        if spheres:
            far = max(spheres, key=lambda geom: np.linalg.norm(data.geom_xpos[geom] - knee))
            return data.geom_xpos[far].copy(), int(model.geom_bodyid[far]), far
        far = max(welded, key=lambda body: np.linalg.norm(data.xpos[body] - knee))
        if far == calf:
            self._refuse(
                f"{model.body(calf).name} has neither a sphere nor a fixed link at its end",
                "a foot is one of them",
            )
        return data.xpos[far].copy(), far, None

    def _limits(self, chain: list[int], sign: Array, offset: Array) -> Array:
        limits = np.full((len(chain), 2), np.nan)
        for place, joint in enumerate(chain):
            if self._model.jnt_limited[joint]:
                ours = sign[place] * self._model.jnt_range[joint] + offset[place]
                limits[place] = np.where(np.isfinite(ours).all(), np.sort(ours), np.nan)
        return limits

    def _effort(self, joint: int) -> float:
        model = self._model
        greatest = []
        if model.jnt_actfrclimited[joint]:
            greatest.append(np.abs(model.jnt_actfrcrange[joint]).max())
        for motor in range(model.nu):
            drives = model.actuator_trntype[motor] == mujoco.mjtTrn.mjTRN_JOINT
            if not drives or model.actuator_trnid[motor, 0] != joint:
                continue
            gear = abs(model.actuator_gear[motor, 0])
            if model.actuator_forcelimited[motor]:
                greatest.append(gear * np.abs(model.actuator_forcerange[motor]).max())
            # What a motor without a bias is sent is its torque, before its gear.
            plain = model.actuator_biastype[motor] == mujoco.mjtBias.mjBIAS_NONE
            if plain and model.actuator_ctrllimited[motor]:
                gain = abs(model.actuator_gainprm[motor, 0])
                greatest.append(gear * gain * np.abs(model.actuator_ctrlrange[motor]).max())
        least = min(greatest, default=np.nan)
        return float(least) if 0.0 < least < np.inf else np.nan

    def _velocities(self, chain: list[int]) -> Array:
        """Returns the greatest velocities (3; rad/s), of which MJCF knows nothing."""
        names = [self._model.joint(joint).name for joint in chain]
        root = ElementTree.fromstring(read_text(self._path, LARGEST_DESCRIPTION))
        limits = {joint.get("name"): joint.find("limit") for joint in root.iterfind("joint")}
        found = [limits.get(name) for name in names]
        try:
            texts = ["nan" if limit is None else limit.get("velocity", "nan") for limit in found]
            given = np.array([float(text) for text in texts])
        except ValueError as error:
            raise InputError(f"{self._path}: a velocity is no number ({error}); mend it") from error
        return np.where((given > 0.0) & np.isfinite(given), given, np.nan)

    def _inertia(self, group: int, turn: Array, origin: Array) -> Inertial:
        """Returns the inertia of a body and what is welded to it.

        Args:
            group: The body.
            turn: From the trunk's axes to ours of that body (3, 3).
            origin: Our origin of that body in the trunk's frame (3; m).
        """
        model, data = self._model, self._data
        parts = []
        for body in range(model.nbody):
            welded = self._own[body] and model.body_weldid[body] == group
            if not welded or not model.body_mass[body]:
                continue
            place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ model.body_ipos[body]
            axes = np.zeros(9)
            mujoco.mju_quat2Mat(axes, model.body_iquat[body])
            own = data.xmat[body].reshape(3, 3) @ axes.reshape(3, 3)
            inertia = turn @ own @ np.diag(model.body_inertia[body]) @ own.T @ turn.T
            (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = inertia.tolist()
            x, y, z = (turn @ (place - origin)).tolist()
            mass = float(model.body_mass[body])
            parts.append(Inertial(mass, (x, y, z), ixx, ixy, ixz, iyy, iyz, izz))
        if not parts:
            name = model.body(group).name if group else self._name
            self._refuse(f"{name} has no mass", "every body that moves has one")
        whole = parts[0]
        for part in parts[1:]:
            whole = merged(whole, part)
        return whole

    def _limb_boxes(self, leg: FoundLeg) -> tuple[tuple[float, ...] | None, ...]:
        """Returns boxes of thigh and calf, their sizes along z, y and x at our angles 0."""
        turns = np.cumsum(leg.offset[1:])
        boxes = []
        for name, turn in zip(leg.bodies[1:], turns, strict=True):
            box = self._box(self._model.body(name).id, _about_y(-turn))
            boxes.append(None if box is None else box[::-1])
        return tuple(boxes)

    def _box(self, group: int, turn: Array) -> tuple[float, ...] | None:
        """Returns the sizes along our axes of a body's greatest box that collides (m)."""
        model = self._model
        boxes = [
            geom
            for geom in range(model.ngeom)
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX
            and self._own[model.geom_bodyid[geom]]
            and model.body_weldid[model.geom_bodyid[geom]] == group
            and (model.geom_contype[geom] or model.geom_conaffinity[geom])
        ]
        if not boxes:
            return None
        greatest = max(boxes, key=lambda geom: model.geom_size[geom].prod())
        axes = turn @ self._data.geom_xmat[greatest].reshape(3, 3)
        x, y, z = 2.0 * np.abs(axes) @ model.geom_size[greatest]
        return float(x), float(y), float(z)

    def _compare(self, legs: dict[str, FoundLeg]) -> None:
        """Refuses legs that are no mirror images of each other in what a robot's file holds."""
        first = legs["FL"]
        for leg, own in legs.items():
            side, ahead = (1.0 if leg[1] == "L" else -1.0), (1.0 if leg[0] == "F" else -1.0)
            differences = {
                "hip joint's place": own.hip * [ahead, side, 1.0] - first.hip,
                "distance from hip joint to thigh": own.outward * side - first.outward,
                "thigh's length": own.thigh_length - first.thigh_length,
                "calf's length": own.calf_length - first.calf_length,
            }
            for what, difference in differences.items():
                if (worst := np.abs(difference).max()) > ALIKE:
                    self._refuse(
                        f"the {what} of {leg} differs by {worst:.4f} m from that of FL",
                        "legs are mirror images of each other",
                    )

    def _refuse(self, problem: str, rule: str) -> Any:
        raise InputError(f"{self._path}: {problem}; {rule}")


def _hanging(limb: Array) -> tuple[float, float]:
    """Returns by which angle about y a limb is turned from straight down (rad), and its length."""
    return float(np.arctan2(-limb[0], -limb[2])), float(np.hypot(limb[0], limb[2]))


def _about_y(angle: float) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
