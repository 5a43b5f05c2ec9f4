"""Neural policies: the experts, with the state estimator that they learned to rely on."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.policy import ArraySpec, Policy, Reals, take_arrays
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import (
    N_ESTIMATED,
    REFLECT_JOINTS,
    Reflection,
    reflect_observation,
)

MAX_LAYERS = 8


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

    reflections: ClassVar[tuple[Reflection, ...]] = ()
    """Mirror images of inputs and of outputs, of networks that treat left and right alike."""

    @property
    def plain(self) -> "Network":
        """The layers themselves."""
        return self

    @property
    def hidden_layers(self) -> tuple[int, ...]:
        """Widths of all layers but the last."""
        return tuple(len(bias) for bias in self.biases[:-1])

    def __call__(self, x: Array) -> Array:
        """Maps inputs (..., n_in) to outputs (..., n_out), in double precision."""
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            x = x @ weight.T + bias
            if i < last:
                x = elu(x)
        return x

    def layers(self, prefix: str) -> dict[str, Array]:
        """Returns the layers by name."""
        weights = {f"{prefix}.{i}.weight": weight for i, weight in enumerate(self.weights)}
        return weights | {f"{prefix}.{i}.bias": bias for i, bias in enumerate(self.biases)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array], prefix: str) -> Self:
        """Rebuilds the network that `layers` took apart."""
        count = _count_layers(arrays, prefix)
        weights, biases = (
            tuple(arrays[f"{prefix}.{i}.{part}"] for i in range(count))
            for part in ("weight", "bias")
        )
        return cls(weights, biases)


def _count_layers(arrays: Mapping[str, NDArray[Any]], prefix: str) -> int:
    return next(i for i in range(len(arrays) + 1) if f"{prefix}.{i}.weight" not in arrays)


@dataclass(frozen=True)
class MirroredNetwork:
    """A network that treats left and right alike: the mean of f(x) and M f(M x), M the mirror.

    Attributes:
        network: f.
        reflect_input: M of its inputs.
        reflect_output: M of its outputs.
    """

    network: Network
    reflect_input: Reflection
    reflect_output: Reflection

    @property
    def plain(self) -> Network:
        """The layers themselves."""
        return self.network

    @property
    def reflections(self) -> tuple[Reflection, ...]:
        """Mirror images of inputs and of outputs."""
        return self.reflect_input, self.reflect_output

    def __call__(self, x: Array) -> Array:
        """Maps inputs (..., n_in) to outputs (..., n_out), in double precision."""
        plain, image = self.network(np.stack([x, self.reflect_input(x)]))
        return 0.5 * (plain + self.reflect_output(image))


class NeuralPolicy(Policy):
    """An expert trained by PPO.

    Attributes:
        actor: Maps the observation to the action.
        mirrored_states: The mirror image of each RM state, if the networks treat left and right
            alike.
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
        """
        Args:
            gait: Name of the gait.
            observation_names: Names of the observations, in order.
            actor: Network from the observation to the action.
            estimator: Network from proprioception to the last seven entries of the observation, or
                odometry.
            mirrored_states: `symmetry.mirrored_states` of the gait, or None.
            robot: The robot; the default one by default.
        """
        super().__init__(gait, observation_names, robot=robot)
        self._networks = {"actor": actor}
        if isinstance(estimator, Network):
            self._networks["estimator"] = estimator
        layers: dict[str, Array] = {}
        for name, network in self._networks.items():
            layers |= network.layers(name)
        self._taken(layers, observation_names, estimator="estimator" in self._networks)
        self.mirrored_states = self._checked_states(mirrored_states)
        self.actor: Network | MirroredNetwork = actor
        self._estimator: Network | MirroredNetwork | Odometry = estimator
        if self.mirrored_states is not None:
            observation = reflect_observation(observation_names, self.mirrored_states)
            proprioception, body = observation.split(len(observation_names) - N_ESTIMATED)
            self.actor = MirroredNetwork(actor, observation, REFLECT_JOINTS)
            if isinstance(estimator, Network):
                self._estimator = MirroredNetwork(estimator, proprioception, body)

    def __call__(self, observation: Array) -> Array:
        return self.actor(observation)

    @property
    def estimator(self) -> Network | MirroredNetwork | Odometry:
        """Odometry, or the map from proprioception to the body state (..., 7)."""
        return self._estimator

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        layers: dict[str, NDArray[Any]] = {}
        for name, network in self._networks.items():
            # Files hold the single precision of training.
            layers |= {key: one.astype(np.float32) for key, one in network.layers(name).items()}
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
        layers = cls._taken(arrays, names["observation_names"], estimator=odometry is None)
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
        count = self.layout.n_machine_states
        numbers = list(range(count))
        whole = isinstance(states, tuple | list) and all(type(i) is int for i in states)
        if not whole or sorted(states) != numbers or [states[i] for i in states] != numbers:
            raise InputError(
                f"{self.kind} policy: mirrored_states is {shown(states)}; it must pair the {count} "
                "RM states, so train the expert anew"
            )
        return tuple(states)

    @classmethod
    def _taken(
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
            return take_arrays(layers, specs, sizes)


def _specs(
    arrays: Mapping[str, NDArray[Any]], prefix: str, n_in: str, n_out: str
) -> dict[str, ArraySpec]:
    """Specifies the arrays of a network, whose layers take what the layers before them give."""
    count = _count_layers(arrays, prefix)
    if not 1 <= count <= MAX_LAYERS:
        raise InputError(f"its {prefix} has {count} layers; train one of 1 to {MAX_LAYERS}")
    widths = (n_in, *(f"{prefix}_{i}" for i in range(count - 1)), n_out)
    specs: dict[str, ArraySpec] = {}
    for i, (before, after) in enumerate(pairwise(widths)):
        specs[f"{prefix}.{i}.weight"] = Reals(f"{after} {before}")
        specs[f"{prefix}.{i}.bias"] = Reals(after)
    return specs
