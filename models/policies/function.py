"""A policy defined by a Python function."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, Robot
from glassgait.models.task.gait import Gait, load_gait
from glassgait.models.task.observation import ObservationLayout


class FunctionPolicy(Policy):
    """Wraps a Python function `observation (..., n) -> action (..., 12)`.

    It has the observation of the shipped experts, with an IMU and odometry, and limited targets.
    """

    kind = "function"

    def __init__(
        self, function: Callable[[Array], Any], gait: Gait | str | Path, robot: Robot | None = None
    ) -> None:
        gait = gait if isinstance(gait, Gait) else load_gait(gait)
        layout = ObservationLayout(gait.n_states, imu=True)
        super().__init__(gait.name, layout.names, robot=robot)
        self._function, self.machine, self._estimator = function, gait, Odometry()
        self.joint_law = DEFAULT_LAW.with_limits(self.robot)

    def act(self, observation: Array) -> Array:
        # The function may write to its argument.
        result = self._function(observation.copy())
        shape = (*observation.shape[:-1], quadruped.N_JOINTS)
        try:
            action = np.asarray(result).astype(float, casting="same_kind", copy=False)
            # A single action (12,) applies to all robots.
            if action.shape in (shape, shape[-1:]):
                return np.broadcast_to(action, shape)
        except (TypeError, ValueError):
            pass
        is_array = isinstance(result, np.ndarray)
        returned = f"{result.dtype} of shape {result.shape}" if is_array else shown(result)
        raise InputError(
            f"the policy's function returned {returned} for an observation of shape "
            f"{observation.shape}; return an array of shape {shape}"
        )

    def save(self, path: Path) -> None:
        raise InputError(f"{path}: a function cannot be saved; keep the program that defines it")
