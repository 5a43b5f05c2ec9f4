"""Batch physics of many robots, independent of the engine."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from glassgait.diagrams.engine import Engine, Held, IntArray
from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import BoolArray
from glassgait.models.robots import kinematics
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import Terrain


class PhysicsStep(NamedTuple):
    """Plant states x (n, 37) after a control period, and which feet touch the ground (n, 4)."""

    states: Array
    touching: BoolArray


class Physics:
    """Advances many robots by control periods; each group of robots has its station."""

    def __init__(self, robot: Robot, engines: Sequence[Engine]) -> None:
        """Sets the engines, each of some consecutive groups."""
        self.robot, self._engines = robot, engines
        self._terrains = [station.terrain for engine in engines for station in engine.stations]
        self.n_groups = len(self._terrains)
        self._friction: Array | None = None

    def __deepcopy__(self, memo: dict[int, object]) -> "Physics":
        # Engines hold C++ objects that cannot be copied; their only state is the friction.
        stations = [station for engine in self._engines for station in engine.stations]
        copied = make_physics(self.robot, *stations)
        if self._friction is not None:
            copied.set_friction(self._friction)
        return copied

    def members(self, n_robots: int) -> list[IntArray]:
        """Returns the indices of each group's robots, which are split evenly and in order."""
        return _members(n_robots, self.n_groups)

    def per_robot(self, values: ArrayLike, n_robots: int) -> Array:
        """Returns for each robot the value of its group, from those of groups (n_groups, ...)."""
        return np.repeat(values, [len(group) for group in self.members(n_robots)], axis=0)

    def gravity(self, n_robots: int) -> Array:
        """Returns the acceleration of gravity for each robot (n_robots, 3; m/s²)."""
        return self.per_robot([terrain.gravity for terrain in self._terrains], n_robots)

    def ground(self, n_robots: int) -> Ground:
        """Returns the ground of each robot."""
        return _ground(tuple(self._terrains), n_robots)

    def set_friction(self, friction: Array) -> None:
        """Sets the friction of each group's ground (n_groups,)."""
        self._friction = friction
        ends = np.cumsum([len(engine.stations) for engine in self._engines])[:-1]
        for engine, values in zip(self._engines, np.split(friction, ends), strict=True):
            engine.set_friction(values)

    def step(
        self,
        states: Array,
        targets: Array,
        *,
        previous_targets: Array | None = None,
        latency: Array | None = None,
    ) -> PhysicsStep:
        """Advances every robot by one control period.

        The state becomes NaN if it or a target is not finite, or if the engine cannot advance it.
        The other robots are not affected.

        Args:
            states: Plant states x (n, 37), in Drake's order.
            targets: Joint positions (n, 12; rad), held after the latency.
            previous_targets: Joint positions held until then (n, 12; rad).
            latency: Time until the targets arrive (n,; s), rounded to plant steps.
        """
        late = targets if previous_targets is None else previous_targets
        latency = np.zeros(len(states)) if latency is None else latency
        held = Held(targets, late, latency)
        # Groups are contiguous, and no group is smaller than the next. An engine's even split of
        # its robots therefore gives the same groups as the split of all robots.
        members, steps = iter(self.members(len(states))), []
        for engine in self._engines:
            robots = np.concatenate([next(members) for _ in engine.stations])
            steps.append(self._advance(engine, states[robots], held.of(robots)))
        return PhysicsStep(*map(np.concatenate, zip(*steps, strict=True)))

    def _advance(self, engine: Engine, states: Array, held: Held) -> PhysicsStep:
        """Advances the finite robots of an engine, each within the middle period of its ground."""
        # Engines take finite numbers only.
        values = np.concatenate([states, held.targets, held.late], axis=1)
        is_finite = np.all(np.isfinite(values), axis=1)
        terrains = tuple(station.terrain for station in engine.stations)
        members = [group[is_finite[group]] for group in _members(len(states), len(terrains))]

        # The ground repeats: the engine simulates robots in the middle period.
        ground = _ground(terrains, len(states))
        away = ground.periods(states)
        after, touching = engine.advance(kinematics.moved_by(states, -away), held, members)
        after = kinematics.moved_by(after, away)
        if touching is None:
            touching = ground.touching(self.robot, after)
        return PhysicsStep(after, touching)


def make_physics(robot: Robot, *stations: StationConfig, n_threads: int | None = None) -> Physics:
    """Makes the physics of groups of robots, by default on all cores.

    Consecutive stations with the same engine share an instance of it.
    """
    engines = []
    for name, group in groupby(stations, key=lambda station: station.engine):
        # Imported here, since most processes need one engine only.
        if name == "drake":
            from glassgait.diagrams.drake_physics import DrakeEngine as MakeEngine  # noqa: PLC0415
        else:
            from glassgait.diagrams.mujoco_physics import MujocoEngine as MakeEngine  # noqa: PLC0415
        engines.append(MakeEngine(robot, list(group), n_threads))
    return Physics(robot, engines)


@lru_cache(maxsize=16)
def _members(n_robots: int, n_groups: int) -> list[IntArray]:
    return np.array_split(np.arange(n_robots), n_groups)


@lru_cache(maxsize=16)
def _ground(terrains: tuple[Terrain, ...], n_robots: int) -> Ground:
    # Cached, since every control step needs it.
    sizes = [len(group) for group in _members(n_robots, len(terrains))]
    return Ground(terrains, np.repeat(np.arange(len(terrains)), sizes))
