"""Terrain: one definition of the ground for physics, heights, contacts and pictures.

Ground other than a plane is made of boxes, one for each cell of a grid that repeats for ever. One
period and its surroundings are enough for a robot that is moved back by whole periods. Boxes reach
into their neighbours' cells, where the higher box counts: otherwise a foot that has sunk in next to
a border would be caught between two side faces. The world's z axis is normal to the mean ground; on
a slope, gravity is inclined instead.
"""

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from annotated_types import Ge, Gt, Le
from numpy.typing import NDArray

from glassgait.models import GRAVITY
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.robots.robot import Robot
from glassgait.models.settings import NotNegative, Seed, Settings, checked

Kind = Literal["plane", "blocks", "steps", "uneven"]

KINDS_OF_KEY: dict[str, tuple[Kind, ...]] = {
    "cell": ("plane", "blocks", "uneven"),
    "cells": ("plane", "blocks", "uneven"),
    "amplitude": ("blocks", "uneven"),
    "wavelength": ("uneven",),
    "height": ("steps",),
    "run": ("steps",),
    "flight": ("steps",),
    "landing": ("steps",),
    "endless": ("steps",),
}
"""Kinds of ground that use a key; all kinds use the other keys."""

REACH = 0.75  # distance around a robot's trunk within which there is ground in a control step (m)
DEPTH = 0.3  # least thickness of the boxes (m); the differences of their tops are added
OVERLAP = 0.03  # how far a box reaches into its neighbours' cells (m), further than feet sink in
MOST_OVERLAP = 0.2  # greatest overlap, as a share of a cell's shorter edge
STAIR_WIDTH = 2.0  # width of a box of the steps (m), which repeat sideways for ever
FLATTEST = 1e-4  # least height that ground of boxes is scaled to (m)


class Grid(NamedTuple):
    """A period of cells."""

    origin: Array  # corner of the first cell (2; m)
    cell: Array  # edges of a cell (2; m)
    top: Array  # height of the middle of each cell's top (nx, ny; m)
    tilt: Array  # rise of each top over its run, along x and y (nx, ny, 2)
    patch: NDArray[np.bool_]  # whether a cell has the patches' friction (nx, ny)
    rise: float  # from a period to the next along x (m)
    depth: float  # thickness of the boxes (m)

    @property
    def period(self) -> Array:
        """Edges of a period (2; m)."""
        return self.cell * self.top.shape

    @property
    def overlap(self) -> float:
        """Length by which a box reaches into its neighbours' cells (m)."""
        return min(OVERLAP, MOST_OVERLAP * float(self.cell.min()))

    @property
    def rotation(self) -> Array:
        """Axes of each cell's box, as columns (nx, ny, 3, 3); the third is normal to its top."""
        zero, one = np.zeros_like(self.top), np.ones_like(self.top)
        along = np.stack([one, zero, self.tilt[..., 0]], -1)
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        normal = np.stack([-self.tilt[..., 0], -self.tilt[..., 1], one], -1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return np.stack([along, np.cross(normal, along), normal], -1)

    @property
    def half_size(self) -> Array:
        """Half edges of each box's top (nx, ny, 2; m), which covers the cell and the overlap."""
        half = self.cell / 2 + self.overlap
        rises = self.tilt * half
        corners = [
            np.stack([x * half[0] + 0 * self.top, y * half[1] + 0 * self.top], -1)
            for x, y in ((1, 1), (1, -1))
        ]
        heights = [rises[..., 0] + rises[..., 1], rises[..., 0] - rises[..., 1]]
        # Distances of these corners from the centre along the box's axes.
        distances = [
            np.abs(np.einsum("...k,...kc->...c", np.dstack([corner, height]), self.rotation))
            for corner, height in zip(corners, heights, strict=True)
        ]
        return np.maximum(*distances)[..., :2]


class GroundBox(NamedTuple):
    """A box of the ground."""

    centre: Array  # (3; m)
    rotation: Array  # its axes, as columns (3, 3)
    size: Array  # its edges (3; m)
    is_patch: bool  # whether it has the patches' friction


@checked
class Terrain(Settings):
    """The ground."""

    title: ClassVar[str] = "terrain"

    # `plane`; `blocks`, a grid of cells of random heights; `steps` along x, up to a landing and
    # down again; `uneven`, noise of long wavelengths, whose cells are tilted.
    kind: Kind = "plane"
    slope: Annotated[float, Ge(-45.0), Le(45.0)] = 0.0  # Angle at which the whole ground rises (°).
    # Direction in which it rises, counted to the left from the world's x axis (°).
    direction: Annotated[float, Ge(-360.0), Le(360.0)] = 0.0
    cell: Annotated[float, Ge(0.1), Le(2.0)] = 0.25  # Edge of a cell (m).
    cells: Annotated[int, Ge(2), Le(12)] = 8  # Cells along a period's edge.
    # Height of the highest cell above the lowest (m).
    amplitude: Annotated[float, Gt(0.0), Le(1.0)] = 0.04
    wavelength: Annotated[float, Gt(0.0), Le(24.0)] = 1.0  # Shortest wavelength of the noise (m).
    # Height of a step (m); with `endless`, a negative one leads down.
    height: Annotated[float, Ge(-1.0), Le(1.0)] = 0.05
    run: Annotated[float, Ge(0.1), Le(2.0)] = 0.3  # Depth of a step (m).
    flight: Annotated[int, Ge(1), Le(20)] = 4  # Steps between two landings.
    # Least depth of a landing (m); robots start in the middle of one.
    landing: Annotated[float, Ge(0.1), Le(5.0)] = 1.2
    endless: bool = False  # Whether all flights lead the same way, instead of up and then down.
    # Share of the cells, or of the steps, with another friction.
    patches: Annotated[float, Ge(0.0), Le(1.0)] = 0.0
    patch_friction: Annotated[NotNegative, Le(100.0)] = 0.4  # Coulomb friction of these patches.
    seed: Seed = 0  # Seed of random heights and patches.

    def __post_init__(self) -> None:
        for key in fields(self):
            kinds = KINDS_OF_KEY.get(key.name, (self.kind,))
            if self.kind not in kinds and getattr(self, key.name) != key.default:
                raise InputError(
                    f"{self.title}: {key.name} is a key of kind {' and '.join(kinds)}, but kind is "
                    f"{self.kind!r}; remove one of them"
                )
        if self.kind == "steps" and (self.height == 0 or (self.height < 0 and not self.endless)):
            raise InputError(
                f"{self.title}: height is {self.height:g}; give more than 0, or endless: true"
            )
        longest, shortest = self.cell * self.cells, 2 * self.cell
        if self.kind == "uneven" and not shortest <= self.wavelength <= longest:
            raise InputError(
                f"{self.title}: wavelength is {self.wavelength:g} m; give {shortest:g} to "
                f"{longest:g} m, or other cells"
            )

    @property
    def is_plane(self) -> bool:
        """True for one plane of one friction, level or sloped."""
        return self.kind == "plane" and self.patches == 0.0

    @property
    def gravity(self) -> Array:
        """Acceleration by gravity (3; m/s²)."""
        slope, direction = math.radians(self.slope), math.radians(self.direction)
        uphill = np.array([math.cos(direction), math.sin(direction), 0.0])
        return GRAVITY * (np.array([0.0, 0.0, -math.cos(slope)]) - math.sin(slope) * uphill)

    def scaled(self, difficulty: float) -> "Terrain":
        """Returns the same ground with its angle and its heights multiplied by a difficulty."""
        heights = {
            key: math.copysign(max(FLATTEST, difficulty * abs(full)), full)
            for key, full in (("amplitude", self.amplitude), ("height", self.height))
            if self.kind in KINDS_OF_KEY[key]
        }
        return replace(self, slope=difficulty * self.slope, **heights)

    def check(self, robot: Robot) -> None:
        """Refuses steps and blocks that are higher than a robot's leg is long."""
        leg = robot.thigh_length + robot.calf_length
        key = "height" if self.kind == "steps" else "amplitude"
        if self.kind in KINDS_OF_KEY[key] and abs(getattr(self, key)) > leg:
            raise InputError(
                f"{self.title}: {key} is {getattr(self, key):g} m, and a leg of the {robot.name} "
                f"is {leg:g} m long; give less"
            )

    def boxes(self, reach: float = REACH) -> Iterator[GroundBox]:
        """Yields the boxes of the middle tile and of the repeated tiles up to `reach` (m) away."""
        grid = grid_of(self)
        rotation, half_size = grid.rotation, grid.half_size
        counts = np.array(grid.top.shape)
        beyond = np.ceil(reach / grid.cell).astype(int)
        for cell in np.ndindex(*(counts + 2 * beyond)):
            # The equivalent cell of the middle period, and the centre of this cell's top.
            place = cell - beyond
            index = tuple(place % counts)
            height = grid.top[index] + grid.rise * (place[0] // counts[0])
            top = np.append(grid.origin + (place + 0.5) * grid.cell, height)
            yield GroundBox(
                centre=top - grid.depth / 2 * rotation[index][:, 2],
                rotation=rotation[index],
                size=np.append(2 * half_size[index], grid.depth),
                is_patch=bool(grid.patch[index]),
            )


PLANE = Terrain()  # a level plane


@cache
def grid_of(terrain: Terrain) -> Grid:
    """Returns the cells of a terrain; those of a plane are level."""
    # Heights and tilts of the cells' tops.
    generator = np.random.default_rng(terrain.seed)
    cell, count = terrain.cell, terrain.cells
    tilt, rise, origin = np.zeros((count, count, 2)), 0.0, -0.5 * cell * np.full(2, count)
    edges = np.full(2, cell)
    match terrain.kind:
        case "plane":
            top = np.zeros((count, count))
        case "blocks":
            top = _between(generator.random((count, count)), terrain.amplitude)
        case "uneven":
            corners = _between(_noise(terrain, generator), terrain.amplitude)
            top, tilt = _planes(corners, cell)
        case "steps":
            top, rise = _stairs(terrain)
            tilt = np.zeros((*top.shape, 2))
            edges = np.array([terrain.run, STAIR_WIDTH])
            origin = np.array([-0.5 * terrain.run * _landing_cells(terrain), -0.5 * STAIR_WIDTH])

    # Cells with the patches' friction.
    patch = np.zeros(top.size, dtype=bool)
    patch[: round(terrain.patches * top.size)] = True
    patch = generator.permutation(patch).reshape(top.shape)
    depth = DEPTH + float(np.ptp(top)) + abs(rise)
    return Grid(origin, edges, top, tilt, patch, rise, depth)


def _between(values: Array, amplitude: float) -> Array:
    """Scales values to the range from 0 to an amplitude."""
    return amplitude * (values - values.min()) / np.ptp(values)


def _noise(terrain: Terrain, generator: np.random.Generator) -> Array:
    """Returns a periodic sum of random waves at the corners of the cells (n, n)."""
    n = terrain.cells
    spectrum = generator.normal(size=(n, n)) + 1j * generator.normal(size=(n, n))
    per_period = np.fft.fftfreq(n, 1.0 / n)
    waves = np.hypot(per_period[:, None], per_period)
    most = terrain.cell * n / terrain.wavelength
    spectrum[(waves == 0) | (waves > most + 1e-9)] = 0.0
    return np.fft.ifft2(spectrum).real


def _planes(corners: Array, cell: float) -> tuple[Array, Array]:
    """Fits planes to cells' corners; returns middle heights (n, n; m) and tilts (n, n, 2)."""
    east, north = np.roll(corners, -1, axis=0), np.roll(corners, -1, axis=1)
    opposite = np.roll(east, -1, axis=1)
    top = (corners + east + north + opposite) / 4
    along = (east + opposite - corners - north) / (2 * cell)
    across = (north + opposite - corners - east) / (2 * cell)
    return top, np.stack([along, across], -1)


def _landing_cells(terrain: Terrain) -> int:
    return int(np.ceil(terrain.landing / terrain.run - 1e-9))


def _stairs(terrain: Terrain) -> tuple[Array, float]:
    """Returns the heights of a period of steps (nx, 1; m), and the rise to the next one (m)."""
    landing, flight = _landing_cells(terrain), terrain.flight
    up = [0] * landing + list(range(1, flight))
    if terrain.endless:
        levels, rise = up, flight
    else:
        levels, rise = [*up, *[flight] * landing, *range(flight - 1, 0, -1)], 0
    return terrain.height * np.array(levels, dtype=float)[:, None], terrain.height * rise
