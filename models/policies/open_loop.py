"""Open-loop policies: a table of actions by the machine's state and the time in it."""

from functools import cached_property
from typing import ClassVar

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.policies.arrays import Reals
from glassgait.models.policies.policy import Policy
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of


class OpenLoopPolicy(Policy):
    """Each action is looked up by reward-machine state and iteration; no sensor but the feet's.

    Attributes:
        table: Actions (n_states, n_iterations, 12); later iterations take the last entry.
    """

    kind = "open_loop"
    array_specs: ClassVar = {"table": Reals("states iterations joints")}
    needed_groups = ("machine state", "iterations")
    table: Array

    @cached_property
    def _iterations(self) -> int:
        (entry,) = indices_of("iterations", self.observation_names)
        return entry

    def __call__(self, observation: Array) -> Array:
        iterations = np.rint(observation[..., self._iterations] / ITERATIONS_SCALE).astype(int)
        last = self.table.shape[1] - 1
        return self.table[self.machine_state(observation), np.clip(iterations, 0, last)]
