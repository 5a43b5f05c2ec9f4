"""The spaces of both environments, and checks of what a person gives them."""

from copy import deepcopy
from typing import Final

import gymnasium as gym
import numpy as np
from gymnasium.vector.utils import batch_space

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout

ACTION_BOUND: Final = 8.0
"""Bound of the action space; eight is 2 rad from the default stance.

A first action of more than 7.7 in one joint ends the episode by itself (`abrupt_action`). In 9,600
control steps of each of the six gaits, with joints, velocities and pushes drawn as in training, the
shipped experts asked for -4.9 to 5.2, falling students for up to 7.9: past the joints' range, for
the PD law takes its torque from there.
"""

SAMPLE_STD: Final = 1.0
"""Standard deviation of random actions: what gymnasium samples where a space has no bound."""


class ActionSpace(gym.spaces.Box):
    """Actions (..., 12) within `ACTION_BOUND`, whose random samples are normal, not uniform.

    An episode ends where the squared change of an action in one step is above 60. Of actions drawn
    uniformly within ±2.7 it is 58 in the mean, and experts go twice as far: no box that holds what
    they do has uniform samples that survive. Of normal ones it is 24, and above 60 once in 350.
    """

    def __init__(
        self,
        shape: tuple[int, ...] = (quadruped.N_JOINTS,),
        seed: int | np.random.Generator | None = None,
    ) -> None:
        super().__init__(-ACTION_BOUND, ACTION_BOUND, shape, np.float64, seed)

    def sample(self, mask: None = None, probability: None = None) -> Array:
        """Draws actions from a normal distribution, cut at the bounds."""
        drawn = self.np_random.normal(scale=SAMPLE_STD, size=self.shape)
        return np.clip(drawn, self.low, self.high)


@batch_space.register(ActionSpace)
def _batch_actions(space: ActionSpace, n: int = 1) -> ActionSpace:
    return ActionSpace((n, *space.shape), deepcopy(space.np_random))


def action_space() -> ActionSpace:
    """Returns the space of actions (12,); see `Robot.joint_targets`."""
    return ActionSpace()


def observation_space(gait: Gait, *, imu: bool = False) -> gym.spaces.Box:
    """Returns the space of observations, of which most know no bound.

    They are (47 + n_states,), or (53 + n_states,) where an IMU is observed.
    """
    size = ObservationLayout(gait.n_states, imu=imu).size
    return gym.spaces.Box(-np.inf, np.inf, (size,), np.float64)
