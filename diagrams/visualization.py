"""Meshcat: the robot on its ground, the gait's display, live or as a standalone page."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from pydrake.geometry import (
    Box,
    Meshcat,
    MeshcatParams,
    Rgba,
)
from pydrake.math import RigidTransform, RotationMatrix

from glassgait.diagrams.station import laid
from glassgait.models.task.terrain import PLANE, Terrain, grid_of
from glassgait.systems.gait_display import (
    PAVEMENT_PATH,
    TILE,
    WORLD_PATH,
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
