"""Linear policies: one weight vector a joint, or one a joint and state of the reward machine."""

from collections.abc import Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from models.a1.robot import Array
from models.policies.policy import Policy


class LinearPolicy(Policy):
    """Each action is a weighted sum of the observations.

    Attributes:
        weights: Weights (12, n).
        intercepts: Intercepts (12,).
    """

    kind = "linear"

    def __init__(
        self, gait: str, observation_names: tuple[str, ...], weights: Array, intercepts: Array
    ) -> None:
        super().__init__(gait, observation_names)
        self.weights = weights
        self.intercepts = intercepts

    def __call__(self, observation: Array) -> Array:
        return observation @ self.weights.T + self.intercepts

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        return {"weights": self.weights, "intercepts": self.intercepts}, {}

    @classmethod
    def from_arrays(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        arrays: Mapping[str, NDArray[Any]],
        values: Mapping[str, Any],
    ) -> Self:
        return cls(gait, observation_names, arrays["weights"], arrays["intercepts"])


class StatewiseLinearPolicy(Policy):
    """A linear policy for each state of the reward machine: a hybrid automaton to read.

    Attributes:
        weights: Weights (n_states, 12, n).
        intercepts: Intercepts (n_states, 12).
    """

    kind = "statewise_linear"

    def __init__(
        self, gait: str, observation_names: tuple[str, ...], weights: Array, intercepts: Array
    ) -> None:
        super().__init__(gait, observation_names)
        self.weights = weights
        self.intercepts = intercepts
        start = observation_names.index("RM State 0")
        self._one_hot = slice(start, start + len(weights))

    def __call__(self, observation: Array) -> Array:
        state = np.argmax(observation[..., self._one_hot], axis=-1)
        weights = self.weights[state]
        return np.einsum("...jn,...n->...j", weights, observation) + self.intercepts[state]

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        return {"weights": self.weights, "intercepts": self.intercepts}, {}

    @classmethod
    def from_arrays(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        arrays: Mapping[str, NDArray[Any]],
        values: Mapping[str, Any],
    ) -> Self:
        return cls(gait, observation_names, arrays["weights"], arrays["intercepts"])
