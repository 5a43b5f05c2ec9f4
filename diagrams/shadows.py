"""Shadows in Meshcat, which has none of its own: how high a foot is over the ground is seen."""

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, Rgba

from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import PLANE, Terrain

SHADE = Rgba(0.0, 0.0, 0.0, 0.18)
"""Colour of one disk; several, one in the other, make a soft edge."""

DISKS = (1.0, 0.7)
"""Radii of the disks of a shadow, as shares of the greatest."""

APART, THICK = 1e-3, 2e-4
"""How far above the ground the first disk is, and each above the one before, and how thick they are
(m): faces at one height would flicker."""

FOOT_REACH = 2.0
"""Radius of the shadow of a foot on the ground, in radii of the foot."""

FADED = 0.12
"""Height of a foot at which its shadow is gone (m)."""


class Shadows:
    """Draws dark disks on the ground under the feet, fainter the higher they are, and the trunk."""

    def __init__(
        self, meshcat: Meshcat, path: str, robot: Robot, *, terrain: Terrain = PLANE
    ) -> None:
        """
        Args:
            meshcat: Where they are drawn.
            path: What they are called there.
            robot: The robot.
            terrain: The ground.
        """
        self._meshcat, self._path, self._robot = meshcat, path, robot
        self._ground = Ground([terrain])
        for name in ("trunk", *quadruped.LEGS):
            for i, radius in enumerate(DISKS):
                own = f"{path}/{name}/{i}"
                meshcat.SetObject(own, Cylinder(radius, THICK), SHADE)
                lifted = np.eye(4)
                lifted[2, 3] = (i + 1) * APART
                meshcat.SetTransform(own, lifted)

    def show(self, state: Array) -> None:
        """Draws the shadows of a robot in a state x (37)."""
        trunk, feet = state[quadruped.POSITION], kinematics.world_feet(self._robot, state)
        ground = self._ground.height(np.vstack([trunk, feet]))
        forward = kinematics.rotation_matrix(state[quadruped.QUATERNION])[:2, 0]
        forward = forward / np.linalg.norm(forward)
        length, width, _ = self._robot.trunk_box
        self._lay("trunk", trunk, ground[0], forward, (0.5 * length, 0.6 * width))
        heights = feet[:, 2] - self._robot.foot_radius - ground[1:]
        shares = np.clip(1.0 - heights / FADED, 0.0, 1.0)
        reach = FOOT_REACH * self._robot.foot_radius
        for leg, foot, below, share in zip(
            quadruped.LEGS, feet, ground[1:], shares.tolist(), strict=True
        ):
            self._lay(leg, foot, below, forward, (reach, reach))
            self._meshcat.SetProperty(f"{self._path}/{leg}", "modulated_opacity", share)

    def _lay(
        self, name: str, above: Array, height: float, forward: Array, radii: tuple[float, float]
    ) -> None:
        """Lays a shadow under a point: an ellipse with its first axis ahead."""
        cosine, sine = forward
        placed = np.eye(4)
        placed[:2, :2] = np.array([[cosine, -sine], [sine, cosine]]) * radii
        placed[:3, 3] = above[0], above[1], height
        self._meshcat.SetTransform(f"{self._path}/{name}", placed)
