"""What the batch simulator asks of a physics engine."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import Terrain


class PhysicsStep(NamedTuple):
    """What a control period of physics brings, robots along the first axis.

    Attributes:
        states: Plant states x (n, 37).
        touching: Whether each foot presses on the ground (n, 4).
    """

    states: Array
    touching: NDArray[np.bool_]


class Held(NamedTuple):
    """What the joints of some robots follow over a control period.

    Attributes:
        targets: Joint position targets (n, 12; rad).
        late: Those that hold until they come (n, 12; rad).
        latency: Time until they come (n,; s).
    """

    targets: Array
    late: Array
    latency: Array

    def of(self, part: slice | NDArray[np.int64]) -> "Held":
        """Returns what some of the robots follow."""
        return Held(*(values[part] for values in self))

    def waits(self, n_steps: int) -> NDArray[np.int64]:
        """Returns the latencies (n,) in steps of a plant that takes `n_steps` in a period."""
        steps = np.rint(self.latency / CONTROL_PERIOD * n_steps).astype(np.int64)
        return np.clip(steps, 0, n_steps)


class Physics(ABC):
    """Advances many robots by control periods; they stand in groups, each on its own ground."""

    def __init__(self, robot: Robot, stations: Sequence[StationConfig]) -> None:
        """
        Args:
            robot: What robots they are.
            stations: Physics of each group.
        """
        self.robot = robot
        self.stations = stations

    @property
    def n_groups(self) -> int:
        """Number of groups."""
        return len(self.stations)

    def members(self, n_robots: int) -> list[NDArray[np.int64]]:
        """Returns the robots of each group: they are split evenly, in order."""
        return _members(n_robots, self.n_groups)

    def gravity(self, n_robots: int) -> Array:
        """Returns the acceleration by gravity of each robot's group (n_robots, 3; m/s²)."""
        members = self.members(n_robots)
        vectors = [station.terrain.gravity for station in self.stations]
        return np.repeat(vectors, [len(group) for group in members], axis=0)

    def ground(self, n_robots: int) -> Ground:
        """Returns what each robot stands on."""
        return _ground(tuple(station.terrain for station in self.stations), n_robots)

    @abstractmethod
    def set_friction(self, friction: Array) -> None:
        """Sets the friction (n_groups,) of each group's ground."""

    def step(
        self,
        states: Array,
        targets: Array,
        *,
        previous_targets: Array | None = None,
        latency: Array | None = None,
    ) -> PhysicsStep:
        """Advances every robot by one control period.

        A robot whose state or target is not finite, or that the engine cannot advance, comes back
        as NaN; the others are as they would be without it.

        Args:
            states: Plant states x (n, 37), as Drake lays them out.
            targets: Joint position targets (n, 12; rad), held over the period.
            previous_targets: Targets of the period before (n, 12; rad), which hold until the new
                ones come; needed with a latency.
            latency: Time from the period's start until the new targets come (n,; s), rounded to
                the plant's steps; by default none.
        """
        late = targets if previous_targets is None else previous_targets
        latency = np.zeros(len(states)) if latency is None else latency
        return self._step(states, Held(targets, late, latency))

    @abstractmethod
    def _step(self, states: Array, held: Held) -> PhysicsStep:
        """Advances every robot by one control period."""


class EnginePhysics(Physics):
    """Robots that one engine advances."""

    def _step(self, states: Array, held: Held) -> PhysicsStep:
        # Those that are sound, each on the tile of ground that is laid.
        values = np.concatenate([states, held.targets, held.late], axis=1)
        sound = np.all(np.isfinite(values), axis=1)
        ground = self.ground(len(states))
        away = ground.periods(states)
        members = [group[sound[group]] for group in self.members(len(states))]
        after, touching = self._advance(kinematics.moved_by(states, -away), held, members)
        after = kinematics.moved_by(after, away)
        if touching is None:
            touching = ground.touching(self.robot, after)
        return PhysicsStep(after, touching)

    @abstractmethod
    def _advance(
        self, states: Array, held: Held, members: list[NDArray[np.int64]]
    ) -> tuple[Array, NDArray[np.bool_] | None]:
        """Advances those of each group's robots that are sound.

        Returns:
            Plant states x (n, 37), NaN of others, and whether each foot presses on the ground (n,
            4); None where that follows from the pose.
        """


class MixedPhysics(Physics):
    """Robots of which some are advanced by one engine and some by another, one after the other."""

    def __init__(self, parts: Sequence[Physics]) -> None:
        """
        Args:
            parts: Physics of the first groups, of the next ones, and so on.
        """
        stations = [station for part in parts for station in part.stations]
        super().__init__(parts[0].robot, stations)
        self._parts = parts
        self._ends = np.cumsum([part.n_groups for part in parts])[:-1]

    def set_friction(self, friction: Array) -> None:
        """Sets the friction (n_groups,) of each group's ground."""
        for part, own in zip(self._parts, np.split(friction, self._ends), strict=True):
            part.set_friction(own)

    def _step(self, states: Array, held: Held) -> PhysicsStep:
        # Groups are contiguous, and none is smaller than the one after it: each part splits its
        # robots as they are split here.
        sizes = [len(group) for group in self.members(len(states))]
        ends = np.cumsum([0, *sizes])[self._ends]
        parts = zip(self._parts, np.split(np.arange(len(states)), ends), strict=True)
        steps = [part._step(states[own], held.of(own)) for part, own in parts]
        return PhysicsStep(*(np.concatenate(values) for values in zip(*steps, strict=True)))


def make_physics(robot: Robot, *stations: StationConfig) -> Physics:
    """Makes the physics of groups of robots.

    Args:
        robot: What robots they are.
        stations: Physics of each group; those of an engine stand side by side.

    Raises:
        InputError: if a station is continuous.
    """
    parts = [
        _physics_of(robot, engine, list(own))
        for engine, own in groupby(stations, key=lambda station: station.engine)
    ]
    return parts[0] if len(parts) == 1 else MixedPhysics(parts)


def _physics_of(robot: Robot, engine: str, stations: Sequence[StationConfig]) -> Physics:
    # Imported here: most processes need one engine.
    if engine == "drake":
        from glassgait.diagrams.drake_physics import DrakePhysics  # noqa: PLC0415

        return DrakePhysics(robot, *stations)
    from glassgait.diagrams.mujoco_physics import MujocoPhysics  # noqa: PLC0415

    return MujocoPhysics(robot, *stations)


def _members(n_robots: int, n_groups: int) -> list[NDArray[np.int64]]:
    return np.array_split(np.arange(n_robots), n_groups)


@lru_cache(maxsize=16)
def _ground(terrains: tuple[Terrain, ...], n_robots: int) -> Ground:
    # Asked for at every control step.
    sizes = [len(group) for group in _members(n_robots, len(terrains))]
    return Ground(terrains, np.repeat(np.arange(len(terrains)), sizes))
