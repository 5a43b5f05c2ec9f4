"""Trained networks and their optimizers: PPO's actor and critic, and the state estimator."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from rsl_rl.modules import MLP
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import nn

from glassgait.models.policies.neural import Network
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import N_ESTIMATED, Reflection, entries_of
from glassgait.studies.training.config import EstimatorConfig, PpoConfig, TrainingConfig
from glassgait.studies.training.environment import OBSERVATION_GROUPS

# Scales the outputs to similar sizes: base velocities are about 1, foot heights some centimetres.
_OUTPUT_SCALE = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1)


class Mirrored(nn.Module):
    """The mean of f(x) and M f(M x) with the mirror M; it is equivariant for any network f."""

    def __init__(
        self, network: nn.Module, reflect_input: Reflection, reflect_output: Reflection
    ) -> None:
        super().__init__()
        self.network = network
        self._reflect_input, self._reflect_output = map(_in_torch, (reflect_input, reflect_output))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Maps inputs (n, n_in) to outputs (n, n_out)."""
        plain, mirrored = self.network(torch.cat([x, self._reflect_input(x)])).chunk(2)
        return 0.5 * (plain + self._reflect_output(mirrored))


def _in_torch(reflection: Reflection) -> Callable[[torch.Tensor], torch.Tensor]:
    index, sign = torch.from_numpy(reflection.index), torch.from_numpy(reflection.sign).float()
    return lambda values: values[:, index] * sign


class LegByLeg(nn.Module):
    """Four networks, one per leg, that observe only that leg and the body.

    They are blocks in the layers of a dense network, whose other weights are 0.
    """

    def __init__(self, dense: nn.Module, names: Sequence[str]) -> None:
        """Sets the weights of a dense network outside the blocks to 0; `names` are its inputs."""
        super().__init__()
        self.layers = nn.ModuleList(linear_layers(dense))
        masks = leg_masks(names, network_of(dense))
        for layer, mask in zip(linear_layers(dense), masks, strict=True):
            layer.weight.data *= torch.from_numpy(mask)
        legs = np.array([entry.leg or "" for entry in entries_of(names)])
        self._observed = [np.flatnonzero(np.isin(legs, ["", leg])) for leg in quadruped.LEGS]

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Maps observations (n, n_in) to actions (n, 12)."""
        return torch.cat([self._of_leg(leg, x) for leg in range(quadruped.N_LEGS)], dim=1)

    def _of_leg(self, leg: int, x: torch.Tensor) -> torch.Tensor:
        for i, layer in enumerate(self.layers):
            weight, bias = (part.tensor_split(quadruped.N_LEGS)[leg] for part in layer.parameters())
            if i == 0:
                x, weight = x[:, self._observed[leg]], weight[:, self._observed[leg]]
            else:
                x = nn.functional.elu(x)
                weight = weight.tensor_split(quadruped.N_LEGS, dim=1)[leg]
            x = nn.functional.linear(x, weight, bias)
        return x


def leg_masks(names: Sequence[str], network: Network) -> list[NDArray[np.bool_]]:
    """Returns a mask (n_out, n_in) per layer of the weights within a leg or from the body to it."""
    legs = [[entry.leg for entry in entries_of(names)]]
    for bias in network.biases:
        units = map(len, np.array_split(bias, quadruped.N_LEGS))
        legs.append(np.repeat(quadruped.LEGS, [*units]).tolist())
    return [
        np.array([[source in (None, leg) for source in before] for leg in after])
        for before, after in pairwise(legs)
    ]


class StateEstimator(nn.Module):
    """Maps proprioception (..., n) to base velocity and foot heights (..., 7)."""

    scale: torch.Tensor

    def __init__(
        self, n_proprioceptive: int, config: EstimatorConfig, reflection: Reflection | None = None
    ) -> None:
        super().__init__()
        mlp = MLP(n_proprioceptive, N_ESTIMATED, config.layers, "elu")
        self.mlp = mlp if reflection is None else Mirrored(mlp, *reflection.split(n_proprioceptive))
        self.register_buffer("scale", torch.tensor(_OUTPUT_SCALE))
        self._config = config

    def forward(self, proprioception: torch.Tensor) -> torch.Tensor:
        return self.mlp(proprioception) * self.scale

    def fit(self, observations: TensorDict, optimizer: torch.optim.Optimizer) -> float:
        """Trains with observation groups (n, ...); returns the mean squared error."""
        inputs, targets = observations["proprioception"], observations["body_state"]
        losses = []
        for _ in range(self._config.epochs):
            for batch in torch.randperm(len(inputs)).chunk(self._config.num_minibatches):
                loss = ((self(inputs[batch]) - targets[batch]) / self.scale).square().mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                losses.append(loss.item())
        return sum(losses) / len(losses)

    def to_network(self) -> Network:
        """Returns the estimator for deployment, with the output scale in the last layer."""
        network = network_of(self.mlp)
        scale = self.scale.numpy().astype(float)
        weights = (*network.weights[:-1], network.weights[-1] * scale[:, None])
        return Network(weights, (*network.biases[:-1], network.biases[-1] * scale))


def linear_layers(network: nn.Module) -> list[nn.Linear]:
    """Lists the linear layers of a torch network, first layer first."""
    return [module for module in network.modules() if isinstance(module, nn.Linear)]


def network_of(mlp: nn.Module) -> Network:
    """Copies the linear layers of a torch network into a NumPy network."""
    layers = linear_layers(mlp)
    return Network(
        tuple(layer.weight.detach().numpy().astype(float) for layer in layers),
        tuple(layer.bias.detach().numpy().astype(float) for layer in layers),
    )


def set_layers(mlp: nn.Module, network: Network) -> None:
    """Copies a NumPy network into the linear layers of a torch network of the same sizes."""
    parts = zip(linear_layers(mlp), network.weights, network.biases, strict=True)
    for layer, weight, bias in parts:
        layer.weight.data.copy_(torch.from_numpy(weight))
        layer.bias.data.copy_(torch.from_numpy(bias))


def gaussian_actor(ppo: PpoConfig, observations: TensorDict) -> MLPModel:
    """Makes an actor with Gaussian actions for observation groups."""
    return MLPModel(
        observations,
        OBSERVATION_GROUPS,
        "actor",
        quadruped.N_JOINTS,
        hidden_dims=ppo.actor_layers,
        distribution_cfg={"class_name": "GaussianDistribution", "init_std": ppo.initial_std},
    )


def set_network(actor: MLPModel, network: nn.Module) -> MLPModel:
    """Replaces an actor's network, which maps observations (n, k) to actions (n, 12)."""
    setattr(actor, "mlp", network)  # noqa: B010
    return actor


class Learner:
    """Trains actor, critic and estimator, and holds their optimizers."""

    def __init__(
        self,
        config: TrainingConfig,
        observations: TensorDict,
        actor: MLPModel,
        estimator: StateEstimator | None = None,
    ) -> None:
        """Makes the critic and the optimizers; observations (n, ...) give the sizes."""
        # Make PPO's networks, storage and optimizer.
        ppo = config.ppo
        self._config = ppo
        critic = MLPModel(
            observations, OBSERVATION_GROUPS, "critic", 1, hidden_dims=ppo.critic_layers
        )
        storage = RolloutStorage(
            "rl", config.n_robots, ppo.steps_per_update, observations, [quadruped.N_JOINTS]
        )
        self.ppo = PPO(
            actor,
            critic,
            storage,
            num_learning_epochs=ppo.epochs,
            num_mini_batches=ppo.num_minibatches,
            clip_param=ppo.clip,
            gamma=ppo.gamma,
            lam=ppo.gae_lambda,
            entropy_coef=ppo.entropy,
            learning_rate=ppo.learning_rate,
            desired_kl=ppo.desired_kl,
            # Returns are about ten times the clip, which would slow the critic down.
            use_clipped_value_loss=False,
        )
        self.ppo.train_mode()

        # A checkpoint contains these modules and optimizers by name.
        self._modules: dict[str, nn.Module] = {"actor": actor, "critic": critic}
        self._optimizers: dict[str, torch.optim.Optimizer] = {"ppo_optimizer": self.ppo.optimizer}
        self._estimator = estimator
        if estimator is not None:
            self._modules["estimator"] = estimator
            self._optimizers["estimator_optimizer"] = torch.optim.Adam(
                estimator.parameters(), lr=config.estimator.learning_rate
            )

    def hold_actor(self, held: bool) -> None:
        """Freezes the actor, so that only the critic learns, or releases it."""
        self.ppo.actor.requires_grad_(not held)
        # A frozen actor has no divergence, so the adaptive rate would grow without bound.
        self.ppo.schedule = "fixed" if held else "adaptive"

    def update(self, last_observations: TensorDict, number: int) -> dict[str, float]:
        """Trains with the stored steps after `number` updates of the run; returns the losses."""
        ppo = self._config
        weights, divergences = (ppo.entropy, ppo.final_entropy), (ppo.desired_kl, ppo.final_kl)
        self.ppo.entropy_coef = float(np.interp(number, ppo.entropy_decay, weights))
        self.ppo.desired_kl = float(np.interp(number, ppo.kl_decay, divergences))

        # Train the estimator with the same steps, which PPO's update clears.
        with torch.inference_mode():
            self.ppo.compute_returns(last_observations)
        stored = self.ppo.storage.observations.flatten(0, 1).clone()
        losses = self.ppo.update()
        if self._estimator is not None:
            losses["estimator"] = self._estimator.fit(
                stored, self._optimizers["estimator_optimizer"]
            )
        losses["action_std"] = self.ppo.actor.output_std.mean().item()
        losses["learning_rate"] = self.ppo.learning_rate
        return losses

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns the state for a checkpoint: named arrays, and values that JSON can hold."""
        # Copy the tensors, since training changes them.
        arrays = {"torch_rng": torch.get_rng_state().numpy()}
        for name, module in self._modules.items():
            for key, value in module.state_dict().items():
                arrays[f"{name}/{key}"] = value.numpy().copy()
        for name, optimizer in self._optimizers.items():
            for index, slot in optimizer.state_dict()["state"].items():
                for key, value in slot.items():
                    arrays[f"{name}/{index}/{key}"] = value.numpy().copy()
        return arrays, {"learning_rate": self.ppo.learning_rate}

    def restore(self, arrays: dict[str, NDArray[Any]], values: dict[str, Any]) -> None:
        """Continues from the results of `to_arrays`."""
        # Load the weights, and the optimizers' state of each parameter.
        tensors = {key: torch.from_numpy(value.copy()) for key, value in arrays.items()}
        for name, module in self._modules.items():
            module.load_state_dict({key: tensors[f"{name}/{key}"] for key in module.state_dict()})
        for name, optimizer in self._optimizers.items():
            state = optimizer.state_dict()
            for path, value in tensors.items():
                prefix, _, rest = path.partition("/")
                if prefix == name:
                    # <optimizer>/<index of the parameter>/<name of the value>
                    index, _, key = rest.partition("/")
                    state["state"].setdefault(int(index), {})[key] = value
            optimizer.load_state_dict(state)

        self.ppo.learning_rate = values["learning_rate"]
        for group in self.ppo.optimizer.param_groups:
            group["lr"] = values["learning_rate"]
        torch.set_rng_state(tensors["torch_rng"])
