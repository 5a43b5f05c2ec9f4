"""The networks that learn, and their optimizers: PPO's actor and critic, and the estimator."""

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
from glassgait.models.task.observation import N_ESTIMATED, Reflection
from glassgait.studies.training.config import EstimatorConfig, PpoConfig, TrainingConfig
from glassgait.studies.training.environment import OBSERVATION_GROUPS

# Foot heights are some centimetres, base velocities about one: the network learns both in tenths.
_OUTPUT_SCALE = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1)


class Mirrored(nn.Module):
    """The mean of f(x) and M f(M x), with M the mirror: equivariant for every network f."""

    input_index: torch.Tensor
    input_sign: torch.Tensor
    output_index: torch.Tensor
    output_sign: torch.Tensor

    def __init__(
        self, network: nn.Module, reflect_input: Reflection, reflect_output: Reflection
    ) -> None:
        super().__init__()
        self.network = network
        for name, reflection in (("input", reflect_input), ("output", reflect_output)):
            index, sign = torch.from_numpy(reflection.index), torch.from_numpy(reflection.sign)
            self.register_buffer(f"{name}_index", index, persistent=False)
            self.register_buffer(f"{name}_sign", sign.float(), persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Maps inputs (n, n_in) to outputs (n, n_out)."""
        image = x[:, self.input_index] * self.input_sign
        plain, mirrored = self.network(torch.cat([x, image])).chunk(2)
        return 0.5 * (plain + mirrored[:, self.output_index] * self.output_sign)


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
        """Learns from observation groups (n, ...), and returns the mean squared error."""
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
        """Returns the estimator for deployment, its output scale folded into the last layer."""
        network = network_of(self.mlp)
        scale = self.scale.numpy().astype(float)
        weights = (*network.weights[:-1], network.weights[-1] * scale[:, None])
        return Network(weights, (*network.biases[:-1], network.biases[-1] * scale))


def network_of(mlp: nn.Module) -> Network:
    """Copies the linear layers of a torch network into a NumPy network."""
    layers = [module for module in mlp.modules() if isinstance(module, nn.Linear)]
    return Network(
        tuple(layer.weight.detach().numpy().astype(float) for layer in layers),
        tuple(layer.bias.detach().numpy().astype(float) for layer in layers),
    )


def set_layers(mlp: nn.Module, network: Network) -> None:
    """Sets the linear layers of a torch network to those of a NumPy network of the same sizes."""
    layers = [module for module in mlp.modules() if isinstance(module, nn.Linear)]
    for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
        layer.weight.data.copy_(torch.from_numpy(weight))
        layer.bias.data.copy_(torch.from_numpy(bias))


def gaussian_actor(ppo: PpoConfig, observations: TensorDict) -> MLPModel:
    """Makes an actor for observation groups: the mean of each action, and a spread."""
    return MLPModel(
        observations,
        OBSERVATION_GROUPS,
        "actor",
        quadruped.N_JOINTS,
        hidden_dims=ppo.actor_layers,
        distribution_cfg={"class_name": "GaussianDistribution", "init_std": ppo.initial_std},
    )


def act_by(actor: MLPModel, network: nn.Module) -> MLPModel:
    """Replaces an actor's network by another one from observations (n, k) to actions (n, 12)."""
    setattr(actor, "mlp", network)  # noqa: B010
    return actor


class Learner:
    """Holds every learned number and every optimizer."""

    def __init__(
        self,
        config: TrainingConfig,
        observations: TensorDict,
        actor: MLPModel,
        estimator: StateEstimator | None = None,
    ) -> None:
        """Makes the critic and the optimizers; observations (n, ...) are for their sizes."""
        # PPO's networks, storage and optimizer.
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
            # Returns are about ten times the clip, which would make the critic a slow follower.
            use_clipped_value_loss=False,
        )
        self.ppo.train_mode()

        # Everything that a checkpoint holds, by name.
        self._modules: dict[str, nn.Module] = {"actor": actor, "critic": critic}
        self._optimizers: dict[str, torch.optim.Optimizer] = {"ppo_optimizer": self.ppo.optimizer}
        self._estimator = estimator
        if estimator is not None:
            self._modules["estimator"] = estimator
            self._optimizers["estimator_optimizer"] = torch.optim.Adam(
                estimator.parameters(), lr=config.estimator.learning_rate
            )

    def hold_actor(self, held: bool) -> None:
        """Lets only the critic learn, or both."""
        self.ppo.actor.requires_grad_(not held)
        # An actor that is held does not diverge, which would raise the rate without end.
        self.ppo.schedule = "fixed" if held else "adaptive"

    def update(self, last_observations: TensorDict, number: int) -> dict[str, float]:
        """Learns from the stored steps, `number` updates into the run, and returns the losses."""
        # The entropy's weight and the divergence follow their schedules.
        ppo = self._config
        weights, divergences = (ppo.entropy, ppo.final_entropy), (ppo.desired_kl, ppo.final_kl)
        self.ppo.entropy_coef = float(np.interp(number, ppo.entropy_decay, weights))
        self.ppo.desired_kl = float(np.interp(number, ppo.kl_decay, divergences))

        # The estimator learns from the same steps, which PPO's update clears.
        with torch.inference_mode():
            self.ppo.compute_returns(last_observations)
        stored = self.ppo.storage.observations.flatten(0, 1).clone()
        losses = self.ppo.update()
        if self._estimator is not None:
            losses["estimator"] = self._estimator.fit(
                stored, self._optimizers["estimator_optimizer"]
            )

        # More columns of the curve.
        losses["action_std"] = self.ppo.actor.output_std.mean().item()
        losses["learning_rate"] = self.ppo.learning_rate
        return losses

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns the state for a checkpoint: named arrays, and values that JSON can hold."""
        # Copies, since the tensors go on changing.
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
        """Continues from what `to_arrays` returned."""
        # The weights, and the optimizers' state of each of them.
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

        # The rate that PPO adapts, and the generator.
        self.ppo.learning_rate = values["learning_rate"]
        for group in self.ppo.optimizer.param_groups:
            group["lr"] = values["learning_rate"]
        torch.set_rng_state(tensors["torch_rng"])
