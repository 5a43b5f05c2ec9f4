"""Open-loop policies: a table of actions by the machine's state and the time in it."""

from typing import ClassVar

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.policies.arrays import Reals
from glassgait.models.policies.capabilities import Capabilities
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of, machine_state_entries


class OpenLoopPolicy(Policy):
    """Each action is looked up by reward-machine state and iteration; no sensor but the feet's.

    Attributes:
        table: Actions (n_states, n_iterations, 12); later iterations take the last entry.
    """

    kind = "open_loop"
    capabilities = Capabilities(
        code="export.policies:open_loop_code", graph="export.graphs.policies:add_open_loop"
    )
    array_specs: ClassVar = {"table": Reals("states iterations joints")}
    needed_groups = ("machine state", "iterations")
    table: Array

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        table: Array,
        *,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(gait, observation_names, robot=robot, table=table)
        self._one_hot = machine_state_entries(observation_names)
        (self._iterations,) = indices_of("iterations", observation_names)

    def __call__(self, observation: Array) -> Array:
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        iterations = np.rint(observation[..., self._iterations] / ITERATIONS_SCALE).astype(int)
        return self.table[state, np.clip(iterations, 0, self.table.shape[1] - 1)]
