"""Neural policies: experts, with the estimator of the body state used in their training."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.policy import ArraySpec, Policy, Reals, checked_arrays
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import (
    N_ESTIMATED,
    REFLECT_JOINTS,
    Reflection,
    reflect_observation,
)

MAX_LAYERS = 8


def elu(x: Array) -> Array:
    return np.where(x > 0.0, x, np.expm1(np.minimum(x, 0.0)))


@dataclass(frozen=True)
class Network:
    """A fully connected network with ELU between its layers, in double precision.

    With reflections M the network is mirror-symmetric: its output is the mean of f(x) and
    M f(M x), and f is the function of its layers.
    """

    weights: tuple[Array, ...]  # matrices (n_out, n_in), first layer first
    biases: tuple[Array, ...]  # vectors (n_out,)
    reflections: tuple[Reflection, Reflection] | None = None  # reflections of inputs and of outputs

    def __call__(self, x: Array) -> Array:
        """Maps inputs (..., n_in) to outputs (..., n_out)."""
        if self.reflections is None:
            return self._apply_layers(x)
        reflect_input, reflect_output = self.reflections
        plain, image = self._apply_layers(np.stack([x, reflect_input(x)]))
        return 0.5 * (plain + reflect_output(image))

    def _apply_layers(self, x: Array) -> Array:
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = (elu(x) if i else x) @ weight.T + bias
        return x

    def layers(self, prefix: str) -> dict[str, Array]:
        weights = {f"{prefix}.{i}.weight": weight for i, weight in enumerate(self.weights)}
        return weights | {f"{prefix}.{i}.bias": bias for i, bias in enumerate(self.biases)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array], prefix: str) -> Self:
        count = _count_layers(arrays, prefix)
        weights, biases = (
            tuple(arrays[f"{prefix}.{i}.{part}"] for i in range(count))
            for part in ("weight", "bias")
        )
        return cls(weights, biases)


def _count_layers(arrays: Mapping[str, NDArray[Any]], prefix: str) -> int:
    return next(i for i in range(len(arrays) + 1) if f"{prefix}.{i}.weight" not in arrays)


class NeuralPolicy(Policy):
    """An expert trained by PPO: an actor, and odometry or a network that estimates the body state.

    Its networks are mirror-symmetric if the mirror image of each RM state is given.
    """

    kind = "neural"

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        actor: Network,
        estimator: Network | Odometry,
        mirrored_states: tuple[int, ...] | None = None,
        *,
        robot: Robot | None = None,
    ) -> None:
        """Takes networks without reflections, and the gait's `symmetry.mirrored_states`."""
        super().__init__(gait, observation_names, robot=robot)

        # Check the layers, named as in files.
        self._networks = {"actor": actor}
        if isinstance(estimator, Network):
            self._networks["estimator"] = estimator
        layers: dict[str, Array] = {}
        for name, network in self._networks.items():
            layers |= network.layers(name)
        self._checked_layers(layers, observation_names, estimator="estimator" in self._networks)

        # Make the networks mirror-symmetric if RM states have mirror images.
        self.mirrored_states = self._checked_states(mirrored_states)
        self.actor = actor
        self._estimator: Network | Odometry = estimator
        if self.mirrored_states is not None:
            observation = reflect_observation(observation_names, self.mirrored_states)
            proprioception, body = observation.split(len(observation_names) - N_ESTIMATED)
            self.actor = replace(actor, reflections=(observation, REFLECT_JOINTS))
            if isinstance(estimator, Network):
                self._estimator = replace(estimator, reflections=(proprioception, body))

    def act(self, observation: Array) -> Array:
        return self.actor(observation)

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        layers: dict[str, NDArray[Any]] = {}
        for name, network in self._networks.items():
            # Training uses single precision, so files do too.
            layers |= {key: a.astype(np.float32) for key, a in network.layers(name).items()}
        values: dict[str, Any] = {}
        if isinstance(self._estimator, Odometry):
            values["odometry"] = asdict(self._estimator)
        if self.mirrored_states is not None:
            values["mirrored_states"] = list(self.mirrored_states)
        return layers, values

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> Self:
        odometry = values.get("odometry")
        layers = cls._checked_layers(arrays, names["observation_names"], estimator=odometry is None)
        with cls._naming_this_kind():
            estimator = odometry and Odometry.from_plain(odometry, "odometry")
        return cls(
            **names,
            actor=Network.from_arrays(layers, "actor"),
            estimator=estimator or Network.from_arrays(layers, "estimator"),
            mirrored_states=values.get("mirrored_states"),
        )

    def _checked_states(self, states: Any) -> tuple[int, ...] | None:
        if states is None:
            return None
        numbers = list(range(self.layout.n_machine_states))
        # Each state must be the image of its image.
        integers = isinstance(states, tuple | list) and all(type(i) is int for i in states)
        if not integers or sorted(states) != numbers or [states[i] for i in states] != numbers:
            problem = f"mirrored_states {shown(states)} does not pair the RM states"
            raise InputError(f"{self.kind} policy: {problem}; train the expert again")
        return tuple(states)

    @classmethod
    def _checked_layers(
        cls,
        layers: Mapping[str, NDArray[Any]],
        observation_names: tuple[str, ...],
        *,
        estimator: bool,
    ) -> dict[str, Array]:
        """Checks the layers of both networks and returns them in double precision."""
        with cls._naming_this_kind():
            sizes = cls._sizes(observation_names)
            sizes |= {"proprioception": sizes["observations"] - N_ESTIMATED, "body": N_ESTIMATED}
            specs = _specs(layers, "actor", "observations", "joints")
            if estimator:
                specs |= _specs(layers, "estimator", "proprioception", "body")
            return checked_arrays(layers, specs, sizes)


def _specs(
    arrays: Mapping[str, NDArray[Any]], prefix: str, n_in: str, n_out: str
) -> dict[str, ArraySpec]:
    count = _count_layers(arrays, prefix)
    if not 1 <= count <= MAX_LAYERS:
        raise InputError(f"its {prefix} has {count} layers; train one of 1 to {MAX_LAYERS}")
    widths = (n_in, *(f"{prefix}_{i}" for i in range(count - 1)), n_out)
    specs: dict[str, ArraySpec] = {}
    for i, (before, after) in enumerate(pairwise(widths)):
        specs[f"{prefix}.{i}.weight"] = Reals(f"{after} {before}")
        specs[f"{prefix}.{i}.bias"] = Reals(after)
    return specs
