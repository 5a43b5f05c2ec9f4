"""Batch physics with MuJoCo, to compare with Drake's."""

from collections import defaultdict
from collections.abc import Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from pydrake.common import Parallelism

from glassgait.diagrams.engine import Engine, Held, IntArray
from glassgait.diagrams.station import PATCH, PAYLOAD_BOX, StationConfig
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, brief
from glassgait.models.estimation.sensors import BoolArray
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.terrain import Terrain

LIMIT_TIME_CONSTANT = 0.004
"""Time constant of joint limits (s). MuJoCo's default is so soft that joints leave their ranges,
which counts as a failure."""

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


class MujocoEngine(Engine):
    """Steps the states of many robots in parallel; each group has its model."""

    def __init__(
        self, robot: Robot, stations: Sequence[StationConfig], n_threads: int | None
    ) -> None:
        super().__init__(stations)
        self._models = [make_model(robot, station) for station in stations]
        self._contact_forces = np.array([station.contact_force for station in stations])
        n_threads = n_threads or Parallelism.Max().num_threads()
        self._rollout = Rollout(nthread=n_threads)
        # One call advances all groups with models of the same sizes, which share their data.
        batches: defaultdict[tuple[int, int], list[int]] = defaultdict(list)
        for group, (model, station) in enumerate(zip(self._models, stations, strict=True)):
            batches[model.signature, station.plant_steps()].append(group)
        self._batches = [
            (groups, n_steps, [mujoco.MjData(self._models[groups[0]]) for _ in range(n_threads)])
            for (_, n_steps), groups in batches.items()
        ]
        self._order = _order_of_state(self._models[0])

    def set_friction(self, friction: Array) -> None:
        for model, station, value in zip(self._models, self.stations, friction, strict=True):
            _set_friction(model, station.terrain, value)

    def advance(
        self, states: Array, held: Held, members: list[IntArray]
    ) -> tuple[Array, BoolArray]:
        touching = np.zeros((len(states), quadruped.N_LEGS), dtype=bool)
        sound = np.concatenate(members)

        # Convert to MuJoCo's order. It has the trunk's angular velocity in the body frame.
        first = self._models[0].nq + 3
        angular = slice(first, first + 3)
        values = np.full_like(states, np.nan)
        values[sound] = states[sound][:, self._order]
        values[sound, angular] = kinematics.base_velocity(states[sound])[1]

        # Advance one batch after another, each on all threads.
        for groups, n_steps, data in self._batches:
            robots = np.concatenate([members[group] for group in groups])
            which = np.repeat(groups, [len(members[group]) for group in groups])
            if len(robots):
                targets = held.of(robots).at_steps(n_steps)
                values[robots], forces = self._roll_out(which, data, values[robots], targets)
                touching[robots] = forces > self._contact_forces[which, None]

        # Convert back to Drake's order and the world frame.
        after = np.full_like(states, np.nan)
        after[:, self._order] = values
        to_world = kinematics.rotation_matrix(after[:, quadruped.QUATERNION])
        after[:, quadruped.ANGULAR_VELOCITY] = np.einsum("nij,nj->ni", to_world, values[:, angular])
        return after, touching

    def _roll_out(
        self, groups: IntArray, data: list[mujoco.MjData], values: Array, targets: Array
    ) -> tuple[Array, Array]:
        """Returns states (n, 37) in MuJoCo's order, and normal forces on the feet (n, 4; N)."""
        # The first entry of MuJoCo's state is time.
        models = [self._models[group] for group in groups]
        before = np.zeros((len(values), mujoco.mj_stateSize(models[0], _STATE)))
        before[:, 1 : 1 + values.shape[1]] = values
        after, sensed = self._rollout.rollout(models, data, before, targets)
        assert after is not None and sensed is not None
        return after[:, -1, 1 : 1 + values.shape[1]], sensed[:, -1]


def _order_of_state(model: mujoco.MjModel) -> IntArray:
    """Returns the index in a plant state x of each of MuJoCo's positions and velocities."""
    index = np.arange(quadruped.N_POSITIONS + quadruped.N_VELOCITIES)
    order, q, v = index.copy(), slice(0, model.nq), slice(model.nq, None)
    joints = [model.joint(name) for name in quadruped.JOINTS]
    order[q][:3], order[q][3:7] = index[quadruped.POSITION], index[quadruped.QUATERNION]
    order[q][[joint.qposadr[0] for joint in joints]] = index[quadruped.JOINT_POSITION]
    order[v][:3] = index[quadruped.LINEAR_VELOCITY]
    order[v][3:6] = index[quadruped.ANGULAR_VELOCITY]
    order[v][[joint.dofadr[0] for joint in joints]] = index[quadruped.JOINT_VELOCITY]
    return order


def make_model(robot: Robot, station: StationConfig) -> mujoco.MjModel:
    """Builds MuJoCo's model of the station, with the same robot, motors, ground and payload."""
    station.terrain.check(robot)

    # The robot description and the integrator.
    spec = _read(robot)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.timestep = station.time_step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 10.0
    # By default MuJoCo silently resets a robot that it cannot advance.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    spec.option.gravity = station.terrain.gravity

    # Ground, payload, motors and sensors.
    for geometry in spec.geoms:
        # The robot collides with the ground only, not with itself.
        collides = not station.feet_only or geometry.name.endswith("_foot")
        geometry.contype, geometry.conaffinity = int(collides), 0
    _add_ground(spec, station.terrain)
    trunk = spec.body("trunk")
    if not trunk.joints:
        trunk.add_freejoint()
    _add_payload(trunk, station)
    _add_motors(spec, robot, station)
    _add_foot_sensors(spec)
    try:
        model = spec.compile()
    except ValueError as error:
        raise _refusal(robot, error) from error
    model.geom_solref[:, 0] = station.contact_time
    _set_friction(model, station.terrain, station.friction)
    return model


def _add_ground(spec: "mujoco.MjSpec", terrain: Terrain) -> None:
    collides = {"contype": 0, "conaffinity": 1}
    if terrain.is_plane:
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0], **collides)
        return
    for i, box in enumerate(terrain.boxes()):
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, box.rotation.ravel())
        spec.worldbody.add_geom(
            name=f"{PATCH if box.is_patch else 'ground'}_{i}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=box.centre,
            quat=quaternion,
            size=box.size / 2,
            **collides,
        )


def _set_friction(model: mujoco.MjModel, terrain: Terrain, friction: float) -> None:
    # MuJoCo uses the greater friction of two geometries: the robot's must not exceed the ground's.
    model.geom_friction[:, 0] = friction
    if terrain.patches:
        model.geom_friction[:, 0] = min(friction, terrain.patch_friction)
        for geometry in range(model.ngeom):
            name = model.geom(geometry).name
            if name.startswith(PATCH):
                model.geom_friction[geometry, 0] = terrain.patch_friction
            elif name.startswith("ground"):
                model.geom_friction[geometry, 0] = friction


def _read(robot: Robot) -> mujoco.MjSpec:
    """Reads a robot description without its visuals, some of which MuJoCo cannot read."""
    root = ElementTree.fromstring(robot.urdf)
    for link in root.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    try:
        return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        raise _refusal(robot, error) from error


def _refusal(robot: Robot, error: ValueError) -> InputError:
    problem = brief(str(error))
    return InputError(f"{robot.urdf_path}: MuJoCo cannot load it ({problem}); correct the file")


def _add_payload(trunk: "mujoco.MjsBody", station: StationConfig) -> None:
    mass = station.payload
    if mass == 0:
        return
    squares = np.square(PAYLOAD_BOX)
    trunk.add_body(
        pos=station.payload_position,
        mass=mass,
        ipos=[0.0, 0.0, 0.0],
        inertia=mass / 12.0 * (squares.sum() - squares),  # of a solid box
        explicitinertial=True,
    )


def _add_motors(spec: mujoco.MjSpec, robot: Robot, station: StationConfig) -> None:
    # The PD law as a motor force that is affine in joint position and velocity, so that MuJoCo
    # integrates the damping implicitly.
    strength = station.motor_strength
    motors = np.broadcast_arrays(robot.effort, *station.gains(robot))
    for name, *motor in zip(quadruped.JOINTS, *motors, strict=True):
        effort, stiffness, damping = (strength * float(value) for value in motor)
        joint = spec.joint(name)
        if station.armature:
            joint.armature = station.armature
        joint.solref_limit = [LIMIT_TIME_CONSTANT, 1.0]
        spec.add_actuator(
            name=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=name,
            gainprm=[stiffness, *[0.0] * 9],
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[0.0, -stiffness, -damping, *[0.0] * 7],
            forcelimited=True,
            forcerange=effort * np.array([-1.0, 1.0]),
        )


def _add_foot_sensors(spec: mujoco.MjSpec) -> None:
    for leg in quadruped.LEGS:
        foot = spec.geom(f"{leg}_foot")
        # A touch sensor sums the normal forces inside its site, which contains the whole foot.
        foot.parent.add_site(
            name=leg,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=foot.pos,
            size=[1.5 * foot.size[0], 0.0, 0.0],
        )
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_TOUCH, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=leg
        )
