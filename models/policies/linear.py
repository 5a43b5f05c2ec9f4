"""Linear policies: one weight vector a joint, or one a joint and state of the reward machine."""

from typing import ClassVar

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.policies.arrays import Reals
from glassgait.models.policies.policy import (
    INTERCEPT,
    Contributions,
    Policy,
    contributions_of_action,
)
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import machine_state_entries


class LinearPolicy(Policy):
    """Each action is a weighted sum of the observations.

    Attributes:
        weights: Weights (12, n).
        intercepts: Intercepts (12,).
    """

    kind = "linear"
    array_specs: ClassVar = {"weights": Reals("joints observations"), "intercepts": Reals("joints")}
    weights: Array
    intercepts: Array

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        weights: Array,
        intercepts: Array,
        *,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(
            gait, observation_names, robot=robot, weights=weights, intercepts=intercepts
        )

    def __call__(self, observation: Array) -> Array:
        return observation @ self.weights.T + self.intercepts

    def _explain(self, observation: Array, joint: int) -> Contributions:
        intercepts = np.full(observation.shape[:-1], self.intercepts[joint])
        parts = self.weights[joint] * observation
        return _contributions(self, intercepts, parts, joint)


class StatewiseLinearPolicy(Policy):
    """A linear policy for each state of the reward machine: a hybrid automaton to read.

    Attributes:
        weights: Weights (n_states, 12, n).
        intercepts: Intercepts (n_states, 12).
    """

    kind = "statewise_linear"
    array_specs: ClassVar = {
        "weights": Reals("states joints observations"),
        "intercepts": Reals("states joints"),
    }
    needed_groups = ("machine state",)
    weights: Array
    intercepts: Array

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        weights: Array,
        intercepts: Array,
        *,
        robot: Robot | None = None,
    ) -> None:
        super().__init__(
            gait, observation_names, robot=robot, weights=weights, intercepts=intercepts
        )
        self._one_hot = machine_state_entries(observation_names)

    def __call__(self, observation: Array) -> Array:
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        weights = self.weights[state]
        return np.einsum("...jn,...n->...j", weights, observation) + self.intercepts[state]

    def state_shares(self, observations: Array) -> Array:
        """Returns the share of observations (m, n) in each state of the machine (n_states,)."""
        return observations[:, self._one_hot].mean(axis=0)

    def _explain(self, observation: Array, joint: int) -> Contributions:
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        parts = self.weights[state, joint] * observation
        intercepts = self.intercepts[state, joint]
        return _contributions(self, intercepts, parts, joint)


def _contributions(policy: Policy, intercepts: Array, parts: Array, joint: int) -> Contributions:
    values = np.concatenate([intercepts[..., None], parts], axis=-1)
    terms = INTERCEPT, *policy.observation_names
    return contributions_of_action(policy.robot, terms, values, joint)
