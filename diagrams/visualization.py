"""Meshcat: the robot on its ground, the gait's display, live or as a standalone page."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from pydrake.geometry import (
    Box,
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    MeshcatVisualizerParams,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder, OutputPort

from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.systems.gait_display import DISPLAY_PERIOD, PAVEMENT_PATH, TILE, GaitDisplay


def open_meshcat(port: int | None = None) -> Meshcat:
    """Starts a Meshcat server that only this machine can reach."""
    with _quiet():
        return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))


def AddLocomotionDisplay(  # noqa: N802
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    robot: Robot,
    gait: Gait,
    *,
    state: OutputPort,
    rm_state: OutputPort,
    foot_contact: OutputPort,
    meshcat: Meshcat,
) -> None:
    """Shows robot, ground, contacts and machine state in Meshcat."""
    draw_ground(meshcat)
    meshcat.SetCameraPose([0.75, -1.05, 0.55], [0.0, 0.0, 0.18])
    MeshcatVisualizer.AddToBuilder(
        builder, scene_graph, meshcat, MeshcatVisualizerParams(publish_period=DISPLAY_PERIOD)
    )
    display = builder.AddNamedSystem("gait_display", GaitDisplay(robot, gait, meshcat))
    builder.Connect(state, display.get_state_input_port())
    builder.Connect(rm_state, display.get_rm_state_input_port())
    builder.Connect(foot_contact, display.get_foot_contact_input_port())


def draw_ground(meshcat: Meshcat) -> None:
    """Draws a pavement of tiles, since a plain plane hides how fast a robot moves.

    Args:
        meshcat: Where it shows, at `PAVEMENT_PATH`.
    """
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 0.9)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.93, 0.95, 0.97])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.80, 0.83, 0.86])
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
