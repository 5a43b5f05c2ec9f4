"""What the batch simulator asks of a physics engine."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
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


def moved_by(states: Array, away: Array) -> Array:
    """Returns plant states x (n, 37) with trunks moved (n, 3; m)."""
    if not away.any():
        return states
    states = states.copy()
    states[:, quadruped.POSITION] += away
    return states


class Physics(Protocol):
    """Advances many robots by control periods; they stand in groups, each on its own ground."""

    stations: Sequence[StationConfig]
    """Physics of each group."""

    @property
    def n_groups(self) -> int:
        """Number of groups."""
        ...

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

    def set_friction(self, friction: Array) -> None:
        """Sets the friction (n_groups,) of each group's ground."""
        ...

    def step(
        self,
        states: Array,
        targets: Array,
        *,
        previous_targets: Array | None = None,
        latency: Array | None = None,
    ) -> PhysicsStep:
        """Advances every robot by one control period.

        Args:
            states: Plant states x (n, 37).
            targets: Joint position targets (n, 12; rad), held over the period.
            previous_targets: Targets of the period before (n, 12; rad), which hold until the new
                ones come; needed with a latency.
            latency: Time from the period's start until the new targets come (n,; s).
        """
        ...


def _members(n_robots: int, n_groups: int) -> list[NDArray[np.int64]]:
    return np.array_split(np.arange(n_robots), n_groups)


@lru_cache(maxsize=16)
def _ground(terrains: tuple[Terrain, ...], n_robots: int) -> Ground:
    # Asked for at every control step.
    sizes = [len(group) for group in _members(n_robots, len(terrains))]
    return Ground(terrains, np.repeat(np.arange(len(terrains)), sizes))
