"""The physics of many robots, by the engine that their station names."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.mujoco_physics import MujocoPhysics
from glassgait.diagrams.physics import Held, Physics, PhysicsStep
from glassgait.diagrams.station import Engine, StationConfig
from glassgait.models.arrays import Array
from glassgait.models.robots.robot import Robot


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


def _physics_of(robot: Robot, engine: Engine, stations: Sequence[StationConfig]) -> Physics:
    if engine == "drake":
        return BatchPhysics(robot, *stations)
    return MujocoPhysics(robot, *stations)
