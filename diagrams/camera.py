"""Pictures of the robot by Drake's VTK engine, without a window or a server."""

import ctypes
import sys

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    Rgba,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.diagrams.visualization import TILE
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot

_RENDERER = "vtk"
_SKY = np.array([0.93, 0.95, 0.97])
_TILES = (Rgba(0.80, 0.82, 0.84, 1.0), Rgba(0.74, 0.76, 0.79, 1.0))


class Camera:
    """Looks at the robot from its side, following it along.

    It needs EGL (Debian: libegl1 and libgl1-mesa-dri).
    """

    def __init__(self, robot: Robot, width: int = 640, height: int = 360) -> None:
        """
        Args:
            robot: The robot.
            width: Width of a picture (pixels).
            height: Height of a picture (pixels).

        Raises:
            InputError: if EGL is missing.
        """
        _check_egl()
        builder = DiagramBuilder()
        self._plant, self._scene_graph, _ = AddStation(builder, robot, StationConfig())
        lights = [
            LightParameter(type="directional", direction=[0.5, 0.6, -1.0], frame="world"),
            LightParameter(
                type="directional", direction=[-0.6, 0.9, -0.4], frame="world", intensity=0.6
            ),
        ]
        engine = MakeRenderEngineVtk(RenderEngineVtkParams(default_clear_color=_SKY, lights=lights))
        self._scene_graph.AddRenderer(_RENDERER, engine)
        self._lay_tiles()
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        core = RenderCameraCore(
            _RENDERER,
            CameraInfo(width, height, np.deg2rad(34)),
            ClippingRange(0.01, 40.0),
            RigidTransform(),
        )
        self._camera = ColorRenderCamera(core, False)

    def take(self, state: Array) -> NDArray[np.uint8]:
        """Renders a plant state x (37) as a picture (height, width, 3)."""
        plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        self._plant.SetPositionsAndVelocities(plant_context, state)
        target = np.array([*state[quadruped.POSITION][:2], 0.17])
        eye = target + np.array([0.45, -1.25, 0.5])
        query = self._scene_graph.get_query_output_port().Eval(
            self._scene_graph.GetMyContextFromRoot(self._context)
        )
        image = query.RenderColorImage(
            self._camera, self._scene_graph.world_frame_id(), _looking(eye, target)
        )
        return np.array(image.data[..., :3])

    def _lay_tiles(self) -> None:
        source = self._plant.get_source_id()
        for i in range(-12, 40):
            for j in range(-12, 12):
                pose = RigidTransform([i * TILE, j * TILE, -0.006])
                tile = GeometryInstance(pose, Box(TILE, TILE, 0.01), f"tile {i} {j}")
                properties = PerceptionProperties()
                properties.AddProperty("phong", "diffuse", _TILES[(i + j) % 2])
                tile.set_perception_properties(properties)
                self._scene_graph.RegisterAnchoredGeometry(source, tile)


def _looking(eye: Array, target: Array) -> RigidTransform:
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    return RigidTransform(RotationMatrix(np.stack([right, down, forward], axis=1)), eye)


def _check_egl() -> None:
    if sys.platform != "linux":
        return
    try:
        # VTK would end the process.
        ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        raise InputError(
            "rendering: EGL is missing; install it with a driver (Debian: libegl1 and "
            "libgl1-mesa-dri), or do not render"
        ) from error
