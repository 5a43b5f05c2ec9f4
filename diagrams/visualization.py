"""Meshcat: the robot on its ground, the gait's display, live or as a standalone page."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from pydrake.geometry import (
    Box,
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder, OutputPort

from glassgait.diagrams.ground import laid
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.terrain import PLANE, Terrain, grid_of
from glassgait.systems.gait_display import (
    DISPLAY_PERIOD,
    PAVEMENT_PATH,
    TILE,
    WORLD_PATH,
    GaitDisplay,
)

BOXES_PATH = f"{WORLD_PATH}/terrain"
"""Meshcat's root of ground that is made of boxes."""

SHADES = ((0.62, 0.64, 0.66), (0.56, 0.58, 0.60))
PATCH_SHADE = (0.55, 0.66, 0.78)
"""Colours of the boxes, and of those with the patches' friction."""


def open_meshcat(port: int | None = None) -> Meshcat:
    """Starts a Meshcat server that only this machine can reach."""
    with _quiet():
        return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))


def AddLocomotionDisplay(  # noqa: N802
    builder: DiagramBuilder,
    robot: Robot,
    gait: Gait,
    terrain: Terrain,
    meshcat: Meshcat,
    *,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    rm_state: OutputPort,
    foot_contact: OutputPort,
) -> None:
    """Shows robot, ground, contacts and machine state in Meshcat.

    Args:
        builder: The builder of the diagram.
        robot: The robot.
        gait: The gait.
        terrain: The ground.
        meshcat: The Meshcat that shows it.
        plant: The robot's plant.
        scene_graph: Its scene graph.
        rm_state: The machine's state (n_states, one-hot).
        foot_contact: Whether each foot touches (4).
    """
    draw_ground(meshcat, terrain)
    meshcat.SetCameraPose([0.75, -1.05, 0.55], [0.0, 0.0, 0.18])
    params = MeshcatVisualizerParams(publish_period=DISPLAY_PERIOD)
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    display = builder.AddNamedSystem("gait_display", GaitDisplay(robot, gait, meshcat))
    # The plant's state, on the ground that is laid.
    builder.Connect(plant.get_state_output_port(), display.GetInputPort("state"))
    builder.Connect(rm_state, display.GetInputPort("rm_state"))
    builder.Connect(foot_contact, display.GetInputPort("foot_contact"))


def draw_ground(meshcat: Meshcat, terrain: Terrain = PLANE) -> None:
    """Draws a pavement of tiles, since a plain plane hides how fast a robot moves, or the boxes.

    Args:
        meshcat: Where it shows, at `PAVEMENT_PATH`; the boxes at `BOXES_PATH`.
        terrain: The ground.
    """
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 0.9)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.93, 0.95, 0.97])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.80, 0.83, 0.86])
    if not terrain.is_plane:
        _draw_boxes(meshcat, terrain)
        return
    ground = f"{PAVEMENT_PATH}/ground"
    meshcat.SetObject(ground, Box(30.0, 30.0, 0.02), Rgba(0.62, 0.64, 0.66, 1.0))
    meshcat.SetTransform(ground, RigidTransform([0.0, 0.0, -0.0125]))
    lines = int(15.0 / TILE)
    for i in range(-lines, lines + 1):
        for name, box, place in (
            (f"x{i}", Box(30.0, 0.006, 0.002), [0.0, i * TILE, -0.002]),
            (f"y{i}", Box(0.006, 30.0, 0.002), [i * TILE, 0.0, -0.002]),
        ):
            meshcat.SetObject(f"{PAVEMENT_PATH}/{name}", box, Rgba(0.5, 0.52, 0.54, 1.0))
            meshcat.SetTransform(f"{PAVEMENT_PATH}/{name}", RigidTransform(place))


def _draw_boxes(meshcat: Meshcat, terrain: Terrain) -> None:
    grid = grid_of(terrain)
    for i, box in enumerate(terrain.boxes(laid(terrain))):
        # Neighbours in two shades, so that one sees where one ends.
        number = int(np.floor((box.centre[:2] - grid.origin) / grid.cell).sum())
        path = f"{BOXES_PATH}/{i}"
        shade = PATCH_SHADE if box.is_patch else SHADES[number % 2]
        meshcat.SetObject(path, Box(*box.size), Rgba(*shade, 1.0))
        meshcat.SetTransform(path, RigidTransform(RotationMatrix(box.rotation), box.centre))


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps Drake from telling of a server that nobody needs to open."""
    log = logging.getLogger("drake")
    level = log.level
    log.setLevel(logging.WARNING)
    try:
        yield
    finally:
        log.setLevel(level)
