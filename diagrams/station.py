"""The station: the robot, its PD-controlled joints, the ground and their contact."""

from collections.abc import Callable
from dataclasses import field, fields, replace
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt, Le
from pydrake.geometry import (
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    HalfSpace,
    ProximityProperties,
    Role,
    RoleAssign,
    SceneGraph,
    SceneGraphConfig,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import (
    ModelInstanceIndex,
    PdControllerGains,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

from glassgait.models.errors import InputError, brief
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, Damping, Gains, JointLaw, Robot, Stiffness
from glassgait.models.settings import Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.ground import Ground
from glassgait.models.task.randomization import Friction
from glassgait.models.task.terrain import PLANE, REACH, Terrain, grid_of
from glassgait.systems.sensors import WorldState

Coordinate = Annotated[float, Ge(-1.0), Le(1.0)]

ContactSolver = Literal["sap", "similar", "lagged"]
"""Drake's discrete contact approximations without TAMSI, which ignores the actuators' PD law."""

MOST_STEPS = 2000  # greatest number of plant steps in a control period, of 10 µs each

DRAKE_KEYS = ("contact_solver", "ground_stiffness", "relaxation_time", "dissipation")
MUJOCO_KEYS = ("contact_force", "contact_time")  # settings of one engine only, as the former

MUJOCO_CONTACT_TIME = 0.01
"""Default time constant of MuJoCo's contacts (s), which gives about the stiffness of Drake's."""

WORLD_STATE = "world_state"
"""Name of the system that outputs the unwrapped state on ground that repeats."""

PAYLOAD_BOX = (0.2, 0.1, 0.05)  # edge lengths of the payload (m)
PATCH = "patch"  # prefix of the names of ground boxes with the patches' friction

GROUND_REACH, MOST_CELLS = 2.5, 12
"""Greatest reach of a diagram's ground around the middle period, in m and in cells."""


@checked
class StationConfig(Settings):
    """Physics of the station."""

    title: ClassVar[str] = "station"

    time_step: Annotated[float, Gt(0)] = 0.01  # period of the plant's discrete updates (s)
    contact_solver: ContactSolver = "sap"  # Drake's `discrete_contact_approximation`
    friction: Friction = 1.0  # Coulomb friction, static and dynamic
    payload: Annotated[float, Ge(0), Le(100.0)] = 0.0  # mass welded to the trunk (kg)
    # SAP's relaxation time (s). With Drake's 0.2 s, feet would stay as deep as they land.
    relaxation_time: Annotated[float, Ge(0)] = 0.01
    # Hunt-Crossley dissipation (s/m), not for SAP; by default Drake's.
    dissipation: Annotated[float, Ge(0), Le(1000.0)] | None = None
    # Stiffness of a foot's contact (N/m), for Drake; with its default, feet sink in by < 1 mm.
    ground_stiffness: Annotated[float, Ge(100.0), Le(1e8)] | None = None
    # In Drake, only feet collide with ground other than a plane.
    terrain: Terrain = field(default_factory=Terrain)
    # Position of the payload's centre in the trunk's frame (m).
    payload_position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    motor_strength: Annotated[float, Gt(0), Le(10.0)] = 1.0  # factor on torque and torque limit
    # Position gain (N·m/rad) without this factor; by default the policy's, otherwise the robot's.
    stiffness: Stiffness | None = None
    damping: Damping | None = None  # velocity gain (N·m·s/rad), with the same defaults
    # Inertia of a motor's rotor, as the joint feels it (kg·m²).
    armature: Annotated[float, Ge(0), Le(1.0)] = 0.0
    feet_only: bool = False  # let only feet collide with the ground, which is faster
    engine: Literal["drake", "mujoco"] = "drake"
    # Normal force above which a foot touches in MuJoCo (N); in Drake it touches if it penetrates.
    contact_force: Annotated[float, Ge(0.0), Le(1000.0)] = 1e-3
    # Time constant of MuJoCo's contacts (s). With its default, 0.02 s, feet sink in by 7 mm.
    contact_time: Annotated[float, Ge(1e-3), Le(1.0)] = MUJOCO_CONTACT_TIME

    def __post_init__(self) -> None:
        keys, other = (MUJOCO_KEYS, "MuJoCo") if self.engine == "drake" else (DRAKE_KEYS, "Drake")
        for key in fields(self):
            if key.name in keys and getattr(self, key.name) != key.default:
                raise InputError(
                    f"{self.title}: {key.name} is a setting of {other}, but engine is "
                    f"{self.engine!r}; remove one of them"
                )

    @property
    def ground(self) -> Ground:
        """The ground under the robots."""
        return Ground([self.terrain])

    def plant_steps(self) -> int:
        """Returns the plant steps in a control period, or raises an InputError if not whole."""
        n_steps = round(min(CONTROL_PERIOD / self.time_step, MOST_STEPS + 1))
        whole = abs(n_steps * self.time_step - CONTROL_PERIOD) <= 1e-12
        if not (whole and 1 <= n_steps <= MOST_STEPS):
            raise InputError(
                f"{self.title}: time_step is {self.time_step}; it must divide the control period, "
                f"{CONTROL_PERIOD} s, into {MOST_STEPS} steps at most"
            )
        return n_steps

    def gains(self, robot: Robot, law: JointLaw = DEFAULT_LAW) -> Gains:
        """Returns stiffness and damping of the joints; missing values come from the law."""
        stiffness, damping = law.gains_of(robot)
        return (
            stiffness if self.stiffness is None else self.stiffness,
            damping if self.damping is None else self.damping,
        )

    def with_gains(self, robot: Robot, law: JointLaw) -> "StationConfig":
        """Returns the station with missing gains replaced by the law's."""
        stiffness, damping = self.gains(robot, law)
        return replace(self, stiffness=stiffness, damping=damping)


def AddStation(  # noqa: N802
    builder: DiagramBuilder, robot: Robot, config: StationConfig, *, reach: float = REACH
) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """Adds the finalized plant with its ground, and its scene graph, to a diagram.

    The joints' actuators contain the PD law, which the contact solver integrates implicitly and
    limits to the motors' effort. In a default context the robot stands at rest. Ground other than a
    plane reaches `reach` (m) around the middle period.
    The returned instance's `desired_state` takes 12 joint positions (rad), then velocities (rad/s).
    """
    if config.engine != "drake":
        raise InputError(
            f"{config.title}: engine is {config.engine!r}; a diagram needs Drake, so remove engine"
        )
    config.terrain.check(robot)

    # Without sampled output ports, the plant is updated in the discrete phase of an instant, after
    # a controller's unrestricted updates.
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=config.time_step,
            contact_model="point",
            discrete_contact_approximation=config.contact_solver,
            use_sampled_output_ports=False,
        ),
        builder,
    )
    # A resolution hint would make Drake register geometries for contact with deformable bodies and
    # warn about half spaces. Point contact needs no hint.
    graph_config = SceneGraphConfig()
    graph_config.default_proximity_properties.resolution_hint = None
    scene_graph.set_config(graph_config)

    # Bodies and motors.
    instance = add_robot(Parser(plant), robot)
    _add_payload(plant, instance, config)
    _add_ground(plant, config.terrain, reach)
    _set_motors(plant, robot, config)
    plant.mutable_gravity_field().set_gravity_vector(config.terrain.gravity)
    plant.Finalize()
    standing = config.ground.stand(robot, kinematics.standing_state(robot))
    plant.SetDefaultPositions(standing[: quadruped.N_POSITIONS])

    # Contact with the ground only.
    feet_only = config.feet_only or not config.terrain.is_plane
    _limit_collisions(plant, scene_graph, instance, feet_only=feet_only)
    _set_compliance(plant, scene_graph, config)
    set_friction(plant, scene_graph, config.friction, terrain=config.terrain)
    return plant, scene_graph, instance


def add_robot(parser: Parser, robot: Robot) -> ModelInstanceIndex:
    """Adds a robot to a parser's plant."""
    try:
        (instance,) = parser.AddModelsFromString(robot.urdf, "urdf")
    except (RuntimeError, ValueError) as error:
        raise InputError(
            f"{robot.urdf_path}: Drake cannot load it ({brief(str(error))}); correct the file"
        ) from error
    return instance


def AddWorldState(  # noqa: N802
    builder: DiagramBuilder, plant: MultibodyPlant, config: StationConfig
) -> OutputPort:
    """Returns the port of the robot's state (37); on ground that repeats, adds `WorldState`."""
    port = plant.get_state_output_port()
    if config.terrain.is_plane:
        return port
    world = builder.AddNamedSystem(WORLD_STATE, WorldState())
    builder.Connect(port, world.get_input_port())
    return world.get_output_port()


def ground_reach(terrain: Terrain) -> float:
    """Returns the reach of a diagram's ground around the middle period (m), limited for speed."""
    return max(REACH, min(GROUND_REACH, MOST_CELLS * float(grid_of(terrain).cell.min())))


def set_friction(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    friction: float,
    context: Context | None = None,
    *,
    terrain: Terrain = PLANE,
) -> None:
    """Sets the friction except that of patches, in a context or as the model's default."""
    ground = set(plant.GetCollisionGeometriesForBody(plant.world_body()))
    inspector = scene_graph.model_inspector()
    feet = 2.0 * max(friction, terrain.patch_friction) if terrain.patches else friction

    def of(geometry: GeometryId) -> CoulombFriction:
        if not terrain.patches or geometry not in ground:
            return CoulombFriction(feet, feet)
        is_patch = inspector.GetName(geometry).startswith(PATCH)
        combined = terrain.patch_friction if is_patch else friction
        # Drake combines the frictions of two bodies as twice their product over their sum.
        value = combined * feet / (2.0 * feet - combined) if combined else 0.0
        return CoulombFriction(value, value)

    where = () if context is None else (context,)
    _set_material(plant, scene_graph, "coulomb_friction", of, where)


def actuated_joints(plant: MultibodyPlant) -> list[str]:
    """Lists the robot's joints in the order of the plant's actuators and of `desired_state`."""
    # The plant has no actuators but the robot's.
    indices = plant.GetJointActuatorIndices()
    return [plant.get_joint_actuator(index).joint().name() for index in indices]


def _set_motors(plant: MultibodyPlant, robot: Robot, config: StationConfig) -> None:
    strength = config.motor_strength
    shares = np.broadcast_arrays(robot.effort, *config.gains(robot))
    motors = dict(zip(quadruped.JOINTS, np.stack(shares, axis=1), strict=True))
    # Before Finalize(), Drake lists no actuators by model instance; all actuators are the robot's.
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_mutable_joint_actuator(index)
        effort, stiffness, damping = strength * motors[actuator.joint().name()]
        actuator.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
        actuator.set_effort_limit(effort)
        actuator.set_default_rotor_inertia(config.armature)


def _add_payload(
    plant: MultibodyPlant, instance: ModelInstanceIndex, config: StationConfig
) -> None:
    if config.payload == 0:
        return
    inertia = SpatialInertia(config.payload, np.zeros(3), UnitInertia.SolidBox(*PAYLOAD_BOX))
    payload = plant.AddRigidBody("payload", instance, inertia)
    place = RigidTransform(np.array(config.payload_position))
    plant.WeldFrames(plant.GetFrameByName("trunk"), payload.body_frame(), place)


def _limit_collisions(
    plant: MultibodyPlant, scene_graph: SceneGraph, instance: ModelInstanceIndex, *, feet_only: bool
) -> None:
    bodies = map(plant.get_body, plant.GetBodyIndices(instance))
    geometries = [item for body in bodies for item in plant.GetCollisionGeometriesForBody(body)]
    no_self_collisions = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(geometries))
    scene_graph.collision_filter_manager().Apply(no_self_collisions)
    for geometry in geometries if feet_only else ():
        if not scene_graph.model_inspector().GetName(geometry).endswith("_foot"):
            scene_graph.RemoveRole(plant.get_source_id(), geometry, Role.kProximity)


def _add_ground(plant: MultibodyPlant, terrain: Terrain, reach: float) -> None:
    world, friction = plant.world_body(), CoulombFriction(1.0, 1.0)
    if terrain.is_plane:
        plant.RegisterCollisionGeometry(world, RigidTransform(), HalfSpace(), "ground", friction)
        return
    for i, box in enumerate(terrain.boxes(reach)):
        pose = RigidTransform(RotationMatrix(box.rotation), box.centre)
        name = f"{PATCH if box.is_patch else 'ground'}_{i}"
        plant.RegisterCollisionGeometry(world, pose, Box(*box.size), name, friction)


def _set_compliance(plant: MultibodyPlant, scene_graph: SceneGraph, config: StationConfig) -> None:
    # Drake adds the relaxation times of the two bodies; a body without one counts as 0.1 s.
    ground = set(plant.GetCollisionGeometriesForBody(plant.world_body()))
    set_material = partial(_set_material, plant, scene_graph)
    relaxation_time, stiffness = config.relaxation_time, config.ground_stiffness
    set_material("relaxation_time", lambda item: 0.0 if item in ground else relaxation_time)
    if stiffness is not None:
        # The two bodies act as springs in series.
        set_material("point_contact_stiffness", lambda _: 2.0 * stiffness)
    if config.dissipation is not None:
        set_material("hunt_crossley_dissipation", lambda _: config.dissipation)


def _set_material(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    name: str,
    value: Callable[[GeometryId], Any],
    where: tuple[Context, ...] = (),
) -> None:
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds(Role.kProximity):
        properties = ProximityProperties(inspector.GetProximityProperties(geometry))
        properties.UpdateProperty("material", name, value(geometry))
        scene_graph.AssignRole(
            *where, plant.get_source_id(), geometry, properties, RoleAssign.kReplace
        )
