"""A function of Python as a policy."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, Robot
from glassgait.models.task.observation import ObservationLayout

if TYPE_CHECKING:
    from glassgait.models.task.gait import Gait


class FunctionPolicy(Policy):
    """A function `observation (..., n) -> action (..., 12)` that observes what shipped experts do.

    It observes an IMU, and the body state by odometry; its joints have the limits that come last.
    """

    kind = "function"

    def __init__(
        self, function: Callable[[Array], Any], gait: "Gait", robot: Robot | None = None
    ) -> None:
        layout = ObservationLayout(gait.n_states, imu=True)
        super().__init__(gait.name, layout.names, robot=robot)
        self._function, self.machine, self._estimator = function, gait, Odometry()
        self.joint_law = DEFAULT_LAW.with_limits(self.robot)

    def act(self, observation: Array) -> Array:
        # Functions may write to what they are given.
        answer = self._function(observation.copy())
        shape = (*observation.shape[:-1], quadruped.N_JOINTS)
        try:
            action = np.asarray(answer, dtype=float)
            # One action (12,) is that of all robots.
            if action.shape in (shape, shape[-1:]):
                return np.broadcast_to(action, shape)
        except (TypeError, ValueError):
            pass
        is_array = isinstance(answer, np.ndarray)
        found = f"an array of shape {answer.shape}" if is_array else shown(answer)
        raise InputError(
            f"the policy's function returned {found} for an observation of shape "
            f"{observation.shape}; return an array of shape {shape}"
        )

    def save(self, path: Path) -> None:
        raise InputError(f"{path}: no file holds a function; keep the program that defines it")
