"""The learned state estimator: regression from proprioception to the body's true state."""

import torch
from rsl_rl.modules import MLP
from tensordict import TensorDict
from torch import nn

from glassgait.models.policies.neural import Network
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.models.task.symmetry import Reflection
from glassgait.studies.training.config import EstimatorConfig
from glassgait.studies.training.mirror import Mirrored

# Foot heights are some centimetres, base velocities about one: the network learns both in tenths.
_OUTPUT_SCALE = (1.0, 1.0, 1.0, 0.1, 0.1, 0.1, 0.1)


class StateEstimator(nn.Module):
    """Maps proprioception (..., n) to base velocity and foot heights (..., 7)."""

    scale: torch.Tensor

    def __init__(
        self,
        n_proprioceptive: int,
        config: EstimatorConfig,
        reflection: Reflection | None = None,
    ) -> None:
        """
        Args:
            n_proprioceptive: Length of the proprioception.
            config: Settings.
            reflection: The mirror of observations, to treat left and right alike.
        """
        super().__init__()
        mlp = MLP(n_proprioceptive, N_ESTIMATED, config.layers, "elu")
        self.mlp = mlp if reflection is None else Mirrored(mlp, *reflection.split(n_proprioceptive))
        self.register_buffer("scale", torch.tensor(_OUTPUT_SCALE))

    def forward(self, proprioception: torch.Tensor) -> torch.Tensor:
        return self.mlp(proprioception) * self.scale

    def to_network(self) -> Network:
        """Returns the estimator for deployment, its output scale folded into the last layer."""
        network = network_of(self.mlp)
        scale = self.scale.numpy().astype(float)
        weights = (*network.weights[:-1], network.weights[-1] * scale[:, None])
        return Network(weights, (*network.biases[:-1], network.biases[-1] * scale))


class EstimatorTrainer:
    """Trains an estimator on the steps that PPO collected."""

    def __init__(self, estimator: StateEstimator, config: EstimatorConfig) -> None:
        self._estimator = estimator
        self._config = config
        self.optimizer = torch.optim.Adam(estimator.parameters(), lr=config.learning_rate)

    def update(self, observations: TensorDict) -> float:
        """Regresses on observation groups (n, ...).

        Returns:
            Mean squared error, in the units that the network learns.
        """
        inputs, targets = observations["proprioception"], observations["body_state"]
        losses = []
        for _ in range(self._config.epochs):
            for batch in torch.randperm(len(inputs)).chunk(self._config.num_minibatches):
                error = (self._estimator(inputs[batch]) - targets[batch]) / self._estimator.scale
                loss = error.square().mean()
                self.optimizer.zero_grad()
                loss.backward()
                self.optimizer.step()
                losses.append(loss.item())
        return sum(losses) / len(losses)


def network_of(mlp: nn.Module) -> Network:
    """Copies the linear layers of a torch network, to be evaluated in NumPy."""
    layers = [module for module in mlp.modules() if isinstance(module, nn.Linear)]
    return Network(
        tuple(layer.weight.detach().numpy().astype(float) for layer in layers),
        tuple(layer.bias.detach().numpy().astype(float) for layer in layers),
    )


def set_layers(mlp: nn.Module, network: Network) -> None:
    """Gives the linear layers of a torch network the numbers of a network of the same sizes."""
    layers = [module for module in mlp.modules() if isinstance(module, nn.Linear)]
    for layer, weight, bias in zip(layers, network.weights, network.biases, strict=True):
        layer.weight.data.copy_(torch.from_numpy(weight))
        layer.bias.data.copy_(torch.from_numpy(bias))
