"""Pictures of robots, as gymnasium's render modes ask for them."""

from typing import Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.camera import Camera
from glassgait.diagrams.egl import check_egl
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD

RENDER_MODES: Final = ("rgb_array",)
RENDER_FPS: Final = round(1 / CONTROL_PERIOD)
"""One picture a control step."""


class Renderer:
    """Takes a picture of each robot where the environment was made to render."""

    def __init__(self, robot: Robot, render_mode: str | None) -> None:
        """
        Raises:
            InputError: if there is no such mode, or EGL cannot render here.
        """
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(
                f"environment: render_mode is {shown(render_mode)}; give "
                f"{' or '.join(map(repr, RENDER_MODES))}, or leave it out"
            )
        self._robot, self._mode = robot, render_mode
        # It takes seconds to build, and its display does not outlive a fork of the process.
        self._camera: Camera | None = None
        if render_mode is not None:
            check_egl()

    def take(self, states: Array) -> tuple[NDArray[np.uint8], ...] | None:
        """Takes pictures (360, 640, 3) of plant states x (n, 37); None without a render mode."""
        if self._mode is None:
            gym.logger.warn(
                "render() draws nothing, for the environment was made without a render mode; make "
                'it with render_mode="rgb_array".'
            )
            return None
        if self._camera is None:
            self._camera = Camera(self._robot)
        return tuple(self._camera.take(state) for state in states)

    def close(self) -> None:
        """Lets go of the camera."""
        self._camera = None
