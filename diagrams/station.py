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
from pydrake.symbolic import Expression, Variable
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort

from glassgait.models.errors import InputError, brief
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, Damping, JointLaw, Robot, Stiffness
from glassgait.models.settings import Settings, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.ground import Ground
from glassgait.models.task.randomization import NOMINAL, Friction
from glassgait.models.task.terrain import PLANE, REACH, Terrain, grid_of
from glassgait.systems.sensors import WorldState

Coordinate = Annotated[float, Ge(-1.0), Le(1.0)]

ContactSolver = Literal["sap", "similar", "lagged"]
"""Drake's discrete contact approximations, less TAMSI: it leaves out the actuators' PD law."""

RANDOM_LIFT = 0.025
"""Height of the trunk above the standing pose in random contexts (m): no foot is in the ground,
whatever the legs' pose."""

MOST_STEPS = 2000  # greatest number of a discrete plant's steps in a control period, of 10 µs each

OF_DRAKE = ("contact_solver", "ground_stiffness", "relaxation_time", "dissipation")
OF_MUJOCO = ("contact_force", "contact_time")  # as the former, settings of one engine only

MUJOCO_CONTACT_TIME = 0.01
"""Time constant of MuJoCo's contacts, by default (s): of as stiff a ground as Drake's is here."""

WORLD_STATE = "world_state"
"""Name of the system that knows where a robot on ground that repeats has gone to."""

PAYLOAD_BOX = (0.2, 0.1, 0.05)  # sizes of the payload (m)

PATCH = "patch"
"""Name of the boxes of the ground that have the patches' friction, before their number."""

LAID, MOST_LAID = 2.5, 12
"""Reach of a diagram's ground around the middle period, in m and in cells: boxes take time."""


@checked
class StationConfig(Settings):
    """Physics of the station."""

    title: ClassVar[str] = "station"

    # Period of the plant's discrete updates (s); 0 for a continuous plant.
    time_step: Annotated[float, Ge(0)] = 0.01
    contact_solver: ContactSolver = "sap"  # Drake's `discrete_contact_approximation`
    friction: Friction = 1.0  # Coulomb's, static and dynamic
    payload: Annotated[float, Ge(0), Le(100.0)] = 0.0  # mass welded to the trunk (kg)
    # Time (s), for SAP. By Drake's 0.2 s feet would stay as deep in the ground as they landed.
    relaxation_time: Annotated[float, Ge(0)] = 0.01
    # Hunt and Crossley's (s/m), not for SAP; by default Drake's.
    dissipation: Annotated[float, Ge(0), Le(1000.0)] | None = None
    # Stiffness of a foot's contact (N/m), for Drake; by its default feet sink in by < 1 mm.
    ground_stiffness: Annotated[float, Ge(100.0), Le(1e8)] | None = None
    # In Drake only feet collide with any but a plane.
    terrain: Terrain = field(default_factory=Terrain)
    # Of the payload's centre in the trunk's frame (m).
    payload_position: tuple[Coordinate, Coordinate, Coordinate] = (0.0, 0.0, 0.0)
    motor_strength: Annotated[float, Gt(0), Le(10.0)] = 1.0  # factor on torque and its limit
    # Position gain (N·m/rad), before that factor; by default the policy's, or the robot's.
    stiffness: Stiffness | None = None
    damping: Damping | None = None  # velocity gain (N·m·s/rad), likewise
    # Inertia of a motor's rotor, as the joint feels it (kg·m²).
    armature: Annotated[float, Ge(0), Le(1.0)] = 0.0
    feet_only: bool = False  # only feet collide with the ground, which takes less time
    engine: Literal["drake", "mujoco"] = "drake"
    # Normal force above which a foot touches (N), for MuJoCo; in Drake it does where inside.
    contact_force: Annotated[float, Ge(0.0), Le(1000.0)] = 1e-3
    # Time constant (s), for MuJoCo. With its default, 0.02 s, feet sink in by 7 mm.
    contact_time: Annotated[float, Ge(1e-3), Le(1.0)] = MUJOCO_CONTACT_TIME

    def __post_init__(self) -> None:
        if self.engine == "mujoco" and self.time_step == 0:
            raise InputError(
                f"{self.title}: time_step is 0, and only Drake's plants are continuous; give a "
                "step such as 0.002, or leave engine out"
            )
        others, owner = (OF_MUJOCO, "MuJoCo") if self.engine == "drake" else (OF_DRAKE, "Drake")
        for key in fields(self):
            if key.name in others and getattr(self, key.name) != key.default:
                raise InputError(
                    f"{self.title}: {key.name} is {owner}'s, and engine is {self.engine!r}; leave "
                    "one of them out"
                )

    @property
    def ground(self) -> Ground:
        """The ground that robots stand on."""
        return Ground([self.terrain])

    def plant_steps(self) -> int:
        """Returns how many steps a discrete plant takes in a control period, or refuses it."""
        ratio = CONTROL_PERIOD / self.time_step if self.time_step else 0.0
        n_steps = round(min(ratio, MOST_STEPS + 1))
        whole = abs(n_steps * self.time_step - CONTROL_PERIOD) <= 1e-12
        if not (whole and 1 <= n_steps <= MOST_STEPS):
            raise InputError(
                f"{self.title}: time_step is {self.time_step}; it must divide the control period, "
                f"{CONTROL_PERIOD} s, into {MOST_STEPS} steps at most"
            )
        return n_steps

    def gains(self, robot: Robot, law: JointLaw = DEFAULT_LAW) -> tuple[float, float]:
        """Returns stiffness and damping of a robot's joints; a law gives those left out here."""
        stiffness, damping = law.gains_of(robot)
        return (
            stiffness if self.stiffness is None else self.stiffness,
            damping if self.damping is None else self.damping,
        )

    def with_gains(self, robot: Robot, law: JointLaw) -> "StationConfig":
        """Returns the station with a law's gains where it leaves them out."""
        stiffness, damping = self.gains(robot, law)
        return replace(self, stiffness=stiffness, damping=damping)


def AddStation(  # noqa: N802
    builder: DiagramBuilder, robot: Robot, config: StationConfig, *, reach: float = REACH
) -> tuple[MultibodyPlant, SceneGraph, ModelInstanceIndex]:
    """Adds the finalized plant, on its ground, and its scene graph to a diagram.

    The PD law lives in the joints' actuators, where the contact solver treats it implicitly and
    limits it to the motors' effort. In a default context the robot stands at rest. In a random one
    each joint is drawn as evaluations draw it, and the trunk is level, `RANDOM_LIFT` above where it
    stands. Ground other than a plane reaches `reach` (m) around the middle period.
    The returned instance's `desired_state` takes 12 joint positions (rad), then velocities (rad/s).

    Raises:
        InputError: if the station is not Drake's, or its ground is too high for the robot.
    """
    if config.engine != "drake":
        raise InputError(
            f"{config.title}: engine is {config.engine!r}, which steps robots in batch; a diagram "
            "needs Drake, so leave engine out"
        )
    config.terrain.check(robot)

    # Output ports are live, so that the plant moves in the discrete phase of an instant, after a
    # controller's unrestricted updates.
    plant, scene_graph = AddMultibodyPlant(
        MultibodyPlantConfig(
            time_step=config.time_step,
            contact_model="point",
            discrete_contact_approximation=config.contact_solver,
            use_sampled_output_ports=False,
        ),
        builder,
    )
    # Drake registers what has a hint of resolution for contact with deformable bodies, and warns
    # that half spaces cannot be. Nothing here deforms, and point contact needs no hint.
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
    _set_initial_poses(plant, robot, config.terrain)

    # Contact, with the ground only.
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
            f"{robot.urdf_path}: Drake refuses it ({brief(str(error))}); mend the file"
        ) from error
    return instance


def AddWorldState(  # noqa: N802
    builder: DiagramBuilder, plant: MultibodyPlant, config: StationConfig
) -> OutputPort:
    """Returns the port of the robot's state (37); on ground that repeats a system gives it."""
    port = plant.get_state_output_port()
    if config.terrain.is_plane:
        return port
    world = builder.AddNamedSystem(WORLD_STATE, WorldState())
    builder.Connect(port, world.get_input_port())
    return world.get_output_port()


def laid(terrain: Terrain) -> float:
    """Returns the reach of a diagram's ground around the middle period (m)."""
    return max(REACH, min(LAID, MOST_LAID * float(grid_of(terrain).cell.min())))


def set_friction(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    friction: float,
    context: Context | None = None,
    *,
    terrain: Terrain = PLANE,
) -> None:
    """Sets the friction of robot and ground, less patches, in a context or the model's default."""
    ground = set(plant.GetCollisionGeometriesForBody(plant.world_body()))
    inspector = scene_graph.model_inspector()
    feet = 2.0 * max(friction, terrain.patch_friction) if terrain.patches else friction

    def of(geometry: GeometryId) -> CoulombFriction:
        if not terrain.patches or geometry not in ground:
            return CoulombFriction(feet, feet)
        is_patch = inspector.GetName(geometry).startswith(PATCH)
        wanted = terrain.patch_friction if is_patch else friction
        # Two bodies have twice the product of their frictions over the sum.
        ground_share = wanted * feet / (2.0 * feet - wanted) if wanted else 0.0
        return CoulombFriction(ground_share, ground_share)

    where = () if context is None else (context,)
    _set_material(plant, scene_graph, "coulomb_friction", of, where)


def actuated_joints(plant: MultibodyPlant) -> list[str]:
    """Names the robot's joints in the order of the plant's actuators and of `desired_state`."""
    # The robot's actuators are all there are.
    indices = plant.GetJointActuatorIndices()
    return [plant.get_joint_actuator(index).joint().name() for index in indices]


def _set_motors(plant: MultibodyPlant, robot: Robot, config: StationConfig) -> None:
    strength, (stiffness, damping) = config.motor_strength, config.gains(robot)
    effort = dict(zip(quadruped.JOINTS, robot.effort, strict=True))
    # Before Finalize() Drake lists no actuators by model instance; the robot's are all there are.
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_mutable_joint_actuator(index)
        gains = PdControllerGains(p=strength * stiffness, d=strength * damping)
        actuator.set_controller_gains(gains)
        actuator.set_effort_limit(strength * effort[actuator.joint().name()])
        actuator.set_default_rotor_inertia(config.armature)


def _set_initial_poses(plant: MultibodyPlant, robot: Robot, terrain: Terrain) -> None:
    # The default: at rest.
    standing = Ground([terrain]).stand(robot, kinematics.standing_state(robot))
    positions = standing[: quadruped.N_POSITIONS]
    plant.SetDefaultPositions(positions)

    # Random contexts: each joint is scaled as evaluations do.
    least, greatest = NOMINAL.joint_scale
    for name, angle in zip(quadruped.JOINTS, robot.default_stance, strict=True):
        uniform = Variable(name, Variable.Type.RANDOM_UNIFORM)
        scale = least + (greatest - least) * uniform
        plant.GetJointByName(name).set_random_angle_distribution(angle * scale)
    # The joints draw one by one, so that the trunk's height cannot follow from the legs' pose.
    place = positions[quadruped.POSITION] + [0.0, 0.0, RANDOM_LIFT]
    base = plant.GetJointByName("trunk")
    base.set_random_translation_distribution([Expression(value) for value in place])


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
    geometries = [one for body in bodies for one in plant.GetCollisionGeometriesForBody(body)]
    none_within = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(geometries))
    scene_graph.collision_filter_manager().Apply(none_within)
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
    # The two bodies of a contact add their relaxation times up, and a body without one counts as
    # 0.1 s.
    ground = set(plant.GetCollisionGeometriesForBody(plant.world_body()))
    set_material = partial(_set_material, plant, scene_graph)
    relaxation_time, stiffness = config.relaxation_time, config.ground_stiffness
    set_material("relaxation_time", lambda one: 0.0 if one in ground else relaxation_time)
    if stiffness is not None:
        # Like two springs in a row.
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
