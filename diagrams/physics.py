"""The physics of many robots, by the engines of their stations."""

from collections.abc import Sequence
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np

from glassgait.diagrams.engine import Engine, Held, IntArray
from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import BoolArray
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import Terrain


class PhysicsStep(NamedTuple):
    """Plant states x (n, 37) after a control period, and which feet press on the ground (n, 4)."""

    states: Array
    touching: BoolArray


class Physics:
    """Advances many robots by control periods; they stand in groups, each on its ground."""

    def __init__(self, robot: Robot, engines: Sequence[Engine]) -> None:
        """Takes the engines of the first groups, of the next ones, and so on."""
        self.robot, self._engines = robot, engines
        self._terrains = [station.terrain for engine in engines for station in engine.stations]
        self.n_groups = len(self._terrains)
        self._friction: Array | None = None

    def __deepcopy__(self, memo: dict[int, object]) -> "Physics":
        # Engines hold C++ objects that cannot be copied, and remember only the friction.
        stations = [station for engine in self._engines for station in engine.stations]
        made = make_physics(self.robot, *stations)
        if self._friction is not None:
            made.set_friction(self._friction)
        return made

    def members(self, n_robots: int) -> list[IntArray]:
        """Returns the robots of each group: they are split evenly, in order."""
        return _members(n_robots, self.n_groups)

    def gravity(self, n_robots: int) -> Array:
        """Returns the acceleration by gravity of each robot's group (n_robots, 3; m/s²)."""
        sizes = [len(group) for group in self.members(n_robots)]
        return np.repeat([terrain.gravity for terrain in self._terrains], sizes, axis=0)

    def ground(self, n_robots: int) -> Ground:
        """Returns the ground of each robot."""
        return _ground(tuple(self._terrains), n_robots)

    def set_friction(self, friction: Array) -> None:
        """Sets the friction (n_groups,) of each group's ground."""
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

        A robot whose state or target is not finite, or that the engine cannot advance, comes back
        as NaN; the others are as they would be without it.

        Args:
            states: Plant states x (n, 37), as Drake lays them out.
            targets: Joint positions (n, 12; rad), held from the latency on.
            previous_targets: Those held until then (n, 12; rad).
            latency: Time until the targets come (n,; s), rounded to the plant's steps.
        """
        late = targets if previous_targets is None else previous_targets
        latency = np.zeros(len(states)) if latency is None else latency
        held = Held(targets, late, latency)
        after, touching = np.empty_like(states), np.empty((len(states), quadruped.N_LEGS), bool)
        # Groups are contiguous, and none is smaller than the one after it: each engine splits its
        # robots as they are split here.
        sizes, start, first = [len(group) for group in self.members(len(states))], 0, 0
        for engine in self._engines:
            last = first + len(engine.stations)
            part = slice(start, start + sum(sizes[first:last]))
            after[part], touching[part] = self._advance(engine, states[part], held.of(part))
            start, first = part.stop, last
        return PhysicsStep(after, touching)

    def _advance(self, engine: Engine, states: Array, held: Held) -> PhysicsStep:
        """Advances the sound robots of an engine, each on the tile of ground that is laid."""
        # One robot that is not finite would stop Drake's batch.
        values = np.concatenate([states, held.targets, held.late], axis=1)
        sound = np.all(np.isfinite(values), axis=1)
        terrains = tuple(station.terrain for station in engine.stations)
        groups = _members(len(states), len(terrains))
        members = [group[sound[group]] for group in groups]

        # Ground repeats: physics sees robots on the middle tile, and the caller where they are.
        ground = _ground(terrains, len(states))
        away = ground.periods(states)
        after, touching = engine.advance(kinematics.moved_by(states, -away), held, members)
        after = kinematics.moved_by(after, away)
        if touching is None:
            touching = ground.touching(self.robot, after)
        return PhysicsStep(after, touching)


def make_physics(robot: Robot, *stations: StationConfig, n_threads: int | None = None) -> Physics:
    """Makes the physics of groups of robots, by default on all cores.

    Groups of one engine stand side by side.
    """
    engines = []
    for name, group in groupby(stations, key=lambda station: station.engine):
        # Imported here: most processes need one engine.
        if name == "drake":
            from glassgait.diagrams.drake_physics import DrakeEngine as MakeEngine  # noqa: PLC0415
        else:
            from glassgait.diagrams.mujoco_physics import MujocoEngine as MakeEngine  # noqa: PLC0415
        engines.append(MakeEngine(robot, list(group), n_threads))
    return Physics(robot, engines)


def _members(n_robots: int, n_groups: int) -> list[IntArray]:
    return np.array_split(np.arange(n_robots), n_groups)


@lru_cache(maxsize=16)
def _ground(terrains: tuple[Terrain, ...], n_robots: int) -> Ground:
    # Asked for at every control step.
    sizes = [len(group) for group in _members(n_robots, len(terrains))]
    return Ground(terrains, np.repeat(np.arange(len(terrains)), sizes))
