"""The ground under robots: its height, the feet's distances from it, and standing poses."""

import copy
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.models import BASE_VELOCITY_SCALE
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.terrain import PLANE, Terrain, grid_of

DESCENTS = 120  # greatest number of steps that lower a robot, each by its distance from the ground
ABOVE = 1e-9  # height at which a robot's lowest foot may be left (m)
FARTHEST = 1e9  # greatest index of a cell


class Ground:
    """The terrains under robots; `which` (n,) has the index of each robot's terrain.

    Without it, all robots stand on the first. Robots are along the leading axes of all arrays.
    `is_level` is true if all terrains are planes, whose height is 0 everywhere.
    """

    def __init__(self, terrains: Sequence[Terrain], which: NDArray[np.int64] | None = None) -> None:
        self._terrains = terrains
        self._which = np.zeros((), dtype=np.int64) if which is None else which
        self._are_rough = np.array([not terrain.is_plane for terrain in terrains])
        self.is_level = not self._are_rough.any()

        # Tables of terrains, and of the cells of all terrains one after another.
        grids = [grid_of(terrain) for terrain in terrains]
        counts = np.array([grid.top.shape for grid in grids])
        sizes = counts.prod(axis=1)
        self._counts, self._first = counts, np.cumsum(sizes) - sizes
        self._origin = np.array([grid.origin for grid in grids])
        self._cell = np.array([grid.cell for grid in grids])
        self._rise = np.array([grid.rise for grid in grids])
        self._overlap = np.array([grid.overlap for grid in grids])
        self._depth = np.array([grid.depth for grid in grids])
        self._period = np.array([grid.period for grid in grids])
        self._top = np.concatenate([grid.top.ravel() for grid in grids])
        self._tilt = np.concatenate([grid.tilt.reshape(-1, 2) for grid in grids])
        self._rotation = np.concatenate([grid.rotation.reshape(-1, 3, 3) for grid in grids])
        self._half_size = np.concatenate([grid.half_size.reshape(-1, 2) for grid in grids])

    def of_robots(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> "Ground":
        """Returns the ground of only the robots at `index`."""
        if self._which.ndim == 0:
            return self
        ground = copy.copy(self)
        ground._which = self._which[index]
        return ground

    @property
    def is_rough(self) -> NDArray[np.bool_]:
        """True for each robot that stands on boxes (n,)."""
        return self._are_rough[self._which]

    def height(self, points: Array) -> Array:
        """Returns the height (..., k; m) of the highest box under points (..., k, 3; m)."""
        heights, rough = np.zeros(points.shape[:-1]), self.is_rough
        if rough.any():
            # Planes need no computation.
            heights[rough] = self.of_robots(rough)._height_of_boxes(points[rough, ..., :2])
        return heights

    def _height_of_boxes(self, points: Array) -> Array:
        number, place, base = self._cells(self._around(points, 0.0))
        along = points[..., None, :] - place
        tops = base + self._top[number] + np.add.reduce(self._tilt[number] * along, axis=-1)
        return tops.max(axis=-1)

    def _around(self, points: Array, reach: float) -> Array:
        """Returns points (..., k, 4, 2; m) in all cells with boxes within `reach` (m) of points."""
        reaches = reach + self._per_robot(self._overlap, points)[..., None, None]
        return points[..., None, :] + reaches * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])

    def clearance(self, centres: Array, radius: float) -> Array:
        """Returns the distance (..., k; m) of spheres from the ground, negative inside it.

        It is exact for spheres (..., k, 3; m) that nearly touch and are smaller than half a cell.
        """
        if self.is_level:
            return centres[..., 2] - radius
        # Centres in the frames of the boxes near them, whose tops are at 0.
        near = self._around(centres[..., :2], 1.25 * radius)
        number, place, base = self._cells(near)
        top = np.concatenate([place, (base + self._top[number])[..., None]], axis=-1)
        local = np.einsum("...k,...kc->...c", centres[..., None, :] - top, self._rotation[number])
        # Distances from these boxes.
        beyond = np.abs(local[..., :2]) - self._half_size[number]
        depth = self._per_robot(self._depth, near)
        height = np.maximum(local[..., 2], -depth - local[..., 2])
        outside = np.sqrt(
            np.sum(np.square(np.maximum(beyond, 0.0)), axis=-1) + np.square(np.maximum(height, 0.0))
        )
        inside = np.minimum(np.maximum(beyond.max(axis=-1), height), 0.0)
        return (outside + inside).min(axis=-1) - radius

    def foot_heights(self, robot: Robot, positions: Array) -> Array:
        """Returns the height of each foot's lowest point above the ground under it (..., 4; m)."""
        heights = kinematics.foot_heights(robot, positions)
        if self.is_level:
            return heights
        return heights - self.height(kinematics.world_feet(robot, positions))

    def clearances(
        self, robot: Robot, positions: Array, shank_share: float
    ) -> kinematics.Clearances:
        """Returns `kinematics.clearances` above the ground under each lowest point.

        The trunk's height is above the mean ground under the feet, so that it does not jump when
        the trunk passes over the edge of a block.
        """
        over_plane = kinematics.clearances(robot, positions, shank_share)
        if self.is_level:
            return over_plane
        lowest = kinematics.lowest_body_points(robot, positions, shank_share)
        feet = kinematics.world_feet(robot, positions)
        under = self.height(np.concatenate([lowest, feet], axis=-2))
        n_boxes = lowest.shape[-2]
        under_body, under_feet = under[..., :n_boxes], under[..., n_boxes:]
        return over_plane._replace(
            body=over_plane.body - under_body,
            feet=over_plane.feet - under_feet,
            trunk=over_plane.trunk - under_feet.mean(axis=-1),
        )

    def touching(self, robot: Robot, positions: Array) -> NDArray[np.bool_]:
        """Returns which feet press on the ground (..., 4): their spheres are inside it.

        Drake's point contact then exerts a force. The result differs from a normal force above 5 N
        in at most 1 % of the steps, when a foot touches an edge lightly.
        """
        if self.is_level:
            return kinematics.foot_heights(robot, positions) < 0.0
        return self.clearance(kinematics.world_feet(robot, positions), robot.foot_radius) < 0.0

    def periods(self, positions: Array) -> Array:
        """Returns the whole periods (n, 3; m) that q (n, 19) or x (n, 37) is off the middle one."""
        if self.is_level:
            return np.zeros((*positions.shape[:-1], 3))
        places = positions[..., quadruped.POSITION][..., :2]
        period = self._period[self._which]
        count = np.floor((places - self._origin[self._which]) / period)
        rise = count[..., 0] * self._rise[self._which]
        return np.concatenate([count * period, rise[..., None]], axis=-1)

    def draw_places(self, count: int, generator: np.random.Generator) -> Array:
        """Draws start positions (count, 2; m) in the middle period; on steps, on its landing."""
        if self.is_level:
            return np.zeros((count, 2))
        drawn = generator.random((count, 2))
        flat = np.array([terrain.is_plane for terrain in self._terrains])
        steps = np.array([terrain.kind == "steps" for terrain in self._terrains])
        size = np.where(flat[:, None], 0.0, self._period)
        size[steps, 0] = 0.0
        return (drawn - 0.5) * size[self._which]

    def stand(self, robot: Robot, states: Array) -> Array:
        """Lowers robots, in states x (n, 37) or positions, until a foot is on the ground."""
        if self.is_level:
            return states
        states = states.copy()
        feet = kinematics.world_feet(robot, states)
        # Start above all boxes near the feet; then the clearance is a free way down.
        around = np.array([[x, y, 0.0] for x in (-1, 0, 1) for y in (-1, 0, 1)])
        near = feet[..., None, :] + around * (1.25 * robot.foot_radius)
        points = near.reshape(*near.shape[:-3], -1, 3)
        tops = self.height(points).reshape(near.shape[:-1]).max(axis=-1)
        lift = (tops + 4 * robot.foot_radius - feet[..., 2]).max(axis=-1)
        for _ in range(DESCENTS):
            down = self.clearance(feet + [0.0, 0.0, 1.0] * lift[..., None, None], robot.foot_radius)
            down = down.min(axis=-1)
            if np.all(down < ABOVE):
                break
            lift = lift - down
        # Rounding must not leave a foot inside the ground.
        states[..., quadruped.POSITION.start + 2] += lift + ABOVE
        return states

    def _cells(self, points: Array) -> tuple[NDArray[np.int64], Array, Array]:
        """Returns table rows, centres (..., 2; m) and base heights (m) of the points' cells."""
        origin, cell = self._per_robot(self._origin, points), self._per_robot(self._cell, points)
        counts, first = self._per_robot(self._counts, points), self._per_robot(self._first, points)
        place = np.floor((points - origin) / cell)
        # NaN, as of a robot whose state is not finite, counts as cell 0.
        place = np.where(np.isnan(place), 0.0, place)
        index = np.minimum(np.maximum(place, -FARTHEST), FARTHEST).astype(np.int64)
        period, in_period = np.divmod(index, counts)
        number = first + in_period[..., 0] * counts[..., 1] + in_period[..., 1]
        centre: Array = np.asarray(origin + (index + 0.5) * cell, dtype=np.float64)
        return number, centre, self._per_robot(self._rise, points) * period[..., 0]

    def _per_robot(self, values: NDArray, points: Array) -> NDArray:
        """Returns the values of each robot's terrain, to broadcast with points (..., k, d)."""
        which, axes = self._which, points.ndim - 1 - self._which.ndim
        return values[which.reshape(which.shape + (1,) * axes) if which.ndim else which]


LEVEL_GROUND = Ground([PLANE])  # a plane, normal to the world's z axis


class FootSense(NamedTuple):
    """Contacts and heights of the feet at one instant."""

    touching: NDArray[np.bool_]  # which feet press on the ground (..., 4)
    contact: NDArray[np.bool_]  # which feet do so now or did at the previous step (..., 4)
    height: Array  # of each foot's lowest point above the ground (..., 4; m)


def sense_feet(
    robot: Robot,
    positions: Array,
    previously_touching: NDArray[np.bool_],
    touching: NDArray[np.bool_] | None = None,
    ground: Ground = LEVEL_GROUND,
) -> FootSense:
    """Returns contacts, by default from the pose, and heights, from q or x.

    Remembering a contact for one step bridges a bouncing touch-down.
    """
    height = ground.foot_heights(robot, positions)
    if touching is None:
        # On level ground, a negative height means contact.
        touching = height < 0.0 if ground.is_level else ground.touching(robot, positions)
    return FootSense(touching=touching, contact=touching | previously_touching, height=height)


def body_state(robot: Robot, state: Array, ground: Ground = LEVEL_GROUND) -> Array:
    """Returns the true base velocity, scaled by 2, and foot heights (..., 7; m/s, m)."""
    linear, _ = kinematics.base_velocity(state)
    heights = ground.foot_heights(robot, state)
    return np.concatenate([BASE_VELOCITY_SCALE * linear, heights], axis=-1)
