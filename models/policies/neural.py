"""Neural policies: the experts, with the state estimator that they learned to rely on."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from models.a1.robot import Array
from models.policies.policy import Policy


def elu(x: Array) -> Array:
    """Evaluates the exponential linear unit."""
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))


@dataclass(frozen=True)
class Network:
    """A fully connected network with ELU between its layers.

    Attributes:
        weights: Matrices (n_out, n_in), first layer first.
        biases: Vectors (n_out,).
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def __call__(self, x: Array) -> Array:
        """Maps inputs (..., n_in) to outputs (..., n_out), in double precision."""
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight.T + bias
            if i < last:
                x = elu(x)
        return x

    def to_arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Returns the layers by name, in single precision as they were trained."""
        arrays = {}
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            arrays[f"{prefix}.{i}.weight"] = weight.astype(np.float32)
            arrays[f"{prefix}.{i}.bias"] = bias.astype(np.float32)
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Self:
        """Rebuilds the network that `to_arrays` named."""
        count = sum(name.startswith(f"{prefix}.") for name in arrays) // 2
        return cls(
            tuple(arrays[f"{prefix}.{i}.weight"].astype(float) for i in range(count)),
            tuple(arrays[f"{prefix}.{i}.bias"].astype(float) for i in range(count)),
        )


class NeuralPolicy(Policy):
    """An expert trained by PPO.

    Attributes:
        actor: Maps the observation to the action.
        estimator: Maps proprioception to the last seven entries of the observation.
    """

    kind = "neural"

    def __init__(
        self, gait: str, observation_names: tuple[str, ...], actor: Network, estimator: Network
    ) -> None:
        super().__init__(gait, observation_names)
        self.actor = actor
        self.estimator = estimator

    def __call__(self, observation: Array) -> Array:
        return self.actor(observation)

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        return self.actor.to_arrays("actor") | self.estimator.to_arrays("estimator"), {}

    @classmethod
    def from_arrays(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        arrays: Mapping[str, NDArray[Any]],
        values: Mapping[str, Any],
    ) -> Self:
        actor = Network.from_arrays(arrays, "actor")
        return cls(gait, observation_names, actor, Network.from_arrays(arrays, "estimator"))
