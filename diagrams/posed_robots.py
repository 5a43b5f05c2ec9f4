"""Robots that are drawn as they are posed, and never simulated."""

from collections.abc import Mapping

import numpy as np
from pydrake.geometry import IllustrationProperties, Rgba, Role, SceneGraph
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import DiagramBuilder

from glassgait.models.robots.robot import Robot

TINT = 0.7
"""Share of a robot's own colour in that of its parts, which can still be distinguished."""


def AddPosedRobots(  # noqa: N802
    builder: DiagramBuilder, robots: Mapping[str, Robot]
) -> tuple[MultibodyPlant, SceneGraph, list[ModelInstanceIndex]]:
    """Adds a plant of robots whose positions are set from outside.

    Args:
        builder: Where it is added.
        robots: The robots by the names under which Meshcat's tree lists them; letters alone.

    Returns:
        The plant, its scene graph, and the robots' model instances, in their order.
    """
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    instances: list[ModelInstanceIndex] = []
    for name, robot in robots.items():
        instances += Parser(plant, name).AddModels(str(robot.urdf_path))
    plant.Finalize()
    return plant, scene_graph, instances


def paint(
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    instance: ModelInstanceIndex,
    color: str,
    *,
    opacity: float = 1.0,
) -> None:
    """Gives a robot a colour of its own.

    Args:
        plant: The finalized plant.
        scene_graph: Its scene graph, before a visualizer is added.
        instance: The robot.
        color: The colour, as hexadecimal red, green and blue.
        opacity: Opacity of all its parts.
    """
    inspector = scene_graph.model_inspector()
    source = plant.get_source_id()
    tint = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    for body in plant.GetBodyIndices(instance):
        frame = plant.GetBodyFrameIdOrThrow(body)
        for geometry in inspector.GetGeometries(frame, Role.kIllustration):
            painted = IllustrationProperties(inspector.GetIllustrationProperties(geometry))
            bare = painted.GetProperty("phong", "diffuse")
            mixed = TINT * tint + (1 - TINT) * np.array([bare.r(), bare.g(), bare.b()])
            painted.UpdateProperty("phong", "diffuse", Rgba(*mixed, opacity))
            # Replaced at once, it would have Drake warn of visualizers; there is none yet.
            scene_graph.RemoveRole(source, geometry, Role.kIllustration)
            scene_graph.AssignRole(source, geometry, painted)
