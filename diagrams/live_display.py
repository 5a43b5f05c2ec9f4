"""A walking robot in Meshcat and, beside it, a translucent ghost."""

from pydrake.geometry import (
    IllustrationProperties,
    Meshcat,
    MeshcatVisualizer,
    Rgba,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.visualization import draw_ground
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import PLANE, Terrain
from glassgait.systems.gait_display import WORLD_PATH, GaitDisplay

GHOST_PATH = f"{WORLD_PATH}/visualizer/ghost"

LANE = 0.6
"""How far to the robot's left the ghost is drawn (m)."""

GHOST_COLOR = Rgba(0.54, 0.58, 0.64, 0.4)


class LiveDisplay:
    """Draws states as they come: the robot with its feet's contacts, and the ghost."""

    def __init__(
        self, robot: Robot, gait: Gait, meshcat: Meshcat, *, terrain: Terrain = PLANE
    ) -> None:
        """
        Args:
            robot: The robot.
            gait: Its gait.
            meshcat: The Meshcat that shows them; what it showed before is deleted.
            terrain: The ground.
        """
        self._meshcat = meshcat
        meshcat.Delete()
        builder = DiagramBuilder()
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        self._instances = [
            Parser(self._plant, name).AddModels(str(robot.urdf_path))[0]
            for name in ("robot", "ghost")
        ]
        self._plant.Finalize()
        _paint(self._plant, scene_graph, self._instances[1])
        draw_ground(meshcat, terrain)
        meshcat.SetCameraPose([0.85, -1.0, 0.55], [0.0, 0.2, 0.1])
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
        marks = builder.AddNamedSystem("gait_display", GaitDisplay(robot, gait, meshcat))
        names = ("state", "rm_state", "foot_contact")
        for name in names:
            builder.ExportInput(marks.GetInputPort(name), name)
        self._diagram = builder.Build()
        self._inputs = {name: self._diagram.GetInputPort(name) for name in names}
        self._context = self._diagram.CreateDefaultContext()
        self._own = self._plant.GetMyMutableContextFromRoot(self._context)
        self._ground = Ground([terrain])
        meshcat.SetTransform(GHOST_PATH, RigidTransform([0.0, LANE, 0.0]))

    def show(
        self,
        state: Array,
        *,
        rm_state: Array,
        foot_contact: Array,
        ghost: Array | None = None,
    ) -> None:
        """Draws one moment.

        Args:
            state: The robot's state x (37).
            rm_state: The machine's state (n_states, one-hot).
            foot_contact: Whether each foot touches (4).
            ghost: The ghost's state x (37), if there is one.
        """
        # Ground that repeats is only laid around its middle period.
        away = self._ground.periods(state)
        beside = kinematics.moved_by(state if ghost is None else ghost, -away)
        state = kinematics.moved_by(state, -away)
        given = {"state": state, "rm_state": rm_state, "foot_contact": foot_contact}
        for name, value in given.items():
            self._inputs[name].FixValue(self._context, value)
        for instance, pose in zip(self._instances, (state, beside), strict=True):
            self._plant.SetPositions(self._own, instance, pose[: quadruped.N_POSITIONS])
        self._diagram.ForcedPublish(self._context)
        self._meshcat.SetProperty(GHOST_PATH, "visible", ghost is not None)


def _paint(plant: MultibodyPlant, scene_graph: SceneGraph, ghost: ModelInstanceIndex) -> None:
    """Gives the ghost its colour, before a visualizer is added."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for body in plant.GetBodyIndices(ghost):
        frame = plant.GetBodyFrameIdOrThrow(body)
        for geometry in inspector.GetGeometries(frame, Role.kIllustration):
            painted = IllustrationProperties(inspector.GetIllustrationProperties(geometry))
            painted.UpdateProperty("phong", "diffuse", GHOST_COLOR)
            # Replaced in one call, it would have Drake warn of visualizers.
            scene_graph.RemoveRole(source, geometry, Role.kIllustration)
            scene_graph.AssignRole(source, geometry, painted)
