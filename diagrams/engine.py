"""The interface of the physics engines, and the joint targets that they hold."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from glassgait.diagrams.station import StationConfig
from glassgait.models.arrays import Array
from glassgait.models.estimation.sensors import BoolArray
from glassgait.models.task import CONTROL_PERIOD

IntArray = NDArray[np.int64]


class Held(NamedTuple):
    """Joint targets of robots over a control period."""

    targets: Array  # joint positions (n, 12; rad)
    late: Array  # previous targets, held until the new ones arrive (n, 12; rad)
    latency: Array  # time until the new ones arrive (n,; s)

    def of(self, robots: slice | IntArray) -> "Held":
        """Returns the targets of some robots."""
        return Held(*(values[robots] for values in self))

    def waits(self, n_steps: int) -> IntArray:
        """Returns the latencies (n,) in plant steps, with `n_steps` in a control period."""
        steps = np.rint(self.latency / CONTROL_PERIOD * n_steps).astype(np.int64)
        return np.clip(steps, 0, n_steps)

    def at_steps(self, n_steps: int) -> Array:
        """Returns the targets at every plant step of the period (n, n_steps, 12; rad)."""
        waiting = np.arange(n_steps) < self.waits(n_steps)[:, None]
        return np.where(waiting[..., None], self.late[:, None], self.targets[:, None])


class Engine(ABC):
    """Advances groups of robots, each with its station."""

    def __init__(self, stations: Sequence[StationConfig]) -> None:
        self.stations = stations

    @abstractmethod
    def set_friction(self, friction: Array) -> None:
        """Sets the friction (n_groups,) of each group's ground."""

    @abstractmethod
    def advance(
        self, states: Array, held: Held, members: list[IntArray]
    ) -> tuple[Array, BoolArray | None]:
        """Advances the members of each group by a control period.

        Returns plant states x (n, 37), NaN for robots in no group, and which feet touch (n, 4), or
        None if contact follows from the pose.
        """
