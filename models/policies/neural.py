"""Neural policies: the experts, with the state estimator that they learned to rely on."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.arrays import ArraySpec, Reals, take_arrays
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.models.task.symmetry import REFLECT_JOINTS, Reflection, reflect_observation

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
    """Of inputs and of outputs, where it treats left and right alike."""

    @property
    def plain(self) -> "Network":
        """The layers themselves."""
        return self

    @property
    def hidden_layers(self) -> tuple[int, ...]:
        """Widths of the layers but for the last."""
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

    def to_arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Returns the layers by name, in single precision as they were trained."""
        return {name: layer.astype(np.float32) for name, layer in self.layers(prefix).items()}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array], prefix: str) -> Self:
        """Rebuilds the network that `to_arrays` named."""
        layers = range(_count_layers(arrays, prefix))
        return cls(
            tuple(arrays[f"{prefix}.{i}.weight"] for i in layers),
            tuple(arrays[f"{prefix}.{i}.bias"] for i in layers),
        )


def _count_layers(arrays: Mapping[str, NDArray[Any]], prefix: str) -> int:
    return next(i for i in range(len(arrays) + 1) if f"{prefix}.{i}.weight" not in arrays)


_NETWORKS = {"actor": ("observations", "joints"), "estimator": ("proprioception", "estimated")}
"""What each network maps to what."""


def _specs(arrays: Mapping[str, NDArray[Any]], *, estimator: bool) -> dict[str, ArraySpec]:
    """Says what the networks' arrays must be: each layer takes what the one before it gives."""
    specs: dict[str, ArraySpec] = {}
    for prefix, (n_in, n_out) in _NETWORKS.items():
        if prefix == "estimator" and not estimator:
            continue
        count = _count_layers(arrays, prefix)
        if count > MAX_LAYERS:
            raise InputError(f"its {prefix} has {count} layers; train one of {MAX_LAYERS} or fewer")
        widths = (n_in, *(f"{prefix}_{i}" for i in range(count - 1)), n_out)
        for i, (before, after) in enumerate(pairwise(widths)):
            specs[f"{prefix}.{i}.weight"] = Reals(f"{after} {before}")
            specs[f"{prefix}.{i}.bias"] = Reals(after)
    return specs


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
        """Of inputs and of outputs."""
        return self.reflect_input, self.reflect_output

    def __call__(self, x: Array) -> Array:
        """Maps inputs (..., n_in) to outputs (..., n_out), in double precision."""
        own, image = self.network(np.stack([x, self.reflect_input(x)]))
        return 0.5 * (own + self.reflect_output(image))


class NeuralPolicy(Policy):
    """An expert trained by PPO.

    Attributes:
        actor: Maps the observation to the action.
        estimator: Maps proprioception to the last seven entries of the observation, or is odometry.
        mirrored_states: What the machine's states stand for in the mirror, if both networks treat
            left and right alike.
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
            observation_names: Names of the observations, in order.
            actor: Network from the observation to the action.
            estimator: Network from proprioception to the last seven entries of the observation, or
                odometry.
            mirrored_states: `symmetry.mirrored_states` of the gait, for networks that are to treat
                left and right alike.

        Raises:
            InputError: if a layer is not what it must be, or the states are no mirror images.
        """
        super().__init__(gait, observation_names, robot=robot)
        self._networks = {"actor": actor}
        if isinstance(estimator, Network):
            self._networks["estimator"] = estimator
        layers = [own.layers(name) for name, own in self._networks.items()]
        self._taken(
            {name: layer for own in layers for name, layer in own.items()},
            observation_names,
            estimator=isinstance(estimator, Network),
        )
        self.mirrored_states = self._checked_states(mirrored_states)
        self.actor: Network | MirroredNetwork = actor
        self._estimator: Network | MirroredNetwork | Odometry = estimator
        if self.mirrored_states is not None:
            observation = reflect_observation(observation_names, self.mirrored_states)
            own, body = observation.split(len(observation_names) - N_ESTIMATED)
            self.actor = MirroredNetwork(actor, observation, REFLECT_JOINTS)
            if isinstance(estimator, Network):
                self._estimator = MirroredNetwork(estimator, own, body)

    def __call__(self, observation: Array) -> Array:
        return self.actor(observation)

    @property
    def estimator(self) -> Network | MirroredNetwork | Odometry:
        """Odometry, or what maps proprioception (..., 40 + n_states) to the body state (..., 7)."""
        return self._estimator

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        layers: dict[str, NDArray[Any]] = {}
        for name, network in self._networks.items():
            layers |= network.to_arrays(name)
        states, values = self.mirrored_states, {}
        if isinstance(self._estimator, Odometry):
            values["odometry"] = asdict(self._estimator)
        if states is not None:
            values["mirrored_states"] = list(states)
        return layers, values

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> Self:
        odometry = values.get("odometry")
        with cls._naming_this_kind():
            estimator = None if odometry is None else Odometry.from_plain(odometry, "odometry")
        layers = cls._taken(arrays, names["observation_names"], estimator=estimator is None)
        return cls(
            **names,
            actor=Network.from_arrays(layers, "actor"),
            estimator=estimator or Network.from_arrays(layers, "estimator"),
            mirrored_states=values.get("mirrored_states"),
        )

    def _checked_states(self, states: Sequence[int] | None) -> tuple[int, ...] | None:
        if states is None:
            return None
        with self._naming_this_kind():
            count = self._sizes(self.observation_names)["states"]
            numbers = list(range(count))
            whole = isinstance(states, tuple | list) and all(type(i) is int for i in states)
            if not whole or sorted(states) != numbers or [states[i] for i in states] != numbers:
                raise InputError(
                    f"mirrored_states is {shown(states)}; it must pair the {count} states of the "
                    "machine, so train the expert anew"
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
            sizes["proprioception"] = sizes["observations"] - N_ESTIMATED
            specs = _specs(layers, estimator=estimator)
            return take_arrays(layers, specs, sizes | {"estimated": N_ESTIMATED})
