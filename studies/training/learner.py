"""The learner: PPO's actor and critic with the state estimator beside them."""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict
from torch import nn

from glassgait.models.robots import quadruped
from glassgait.studies.training.config import PpoConfig, TrainingConfig
from glassgait.studies.training.environment import OBSERVATION_GROUPS
from glassgait.studies.training.estimator import EstimatorTrainer, StateEstimator


def gaussian_actor(ppo: PpoConfig, observations: TensorDict) -> MLPModel:
    """Makes an actor: a network that gives the mean of each action, and their spread.

    Args:
        ppo: Settings.
        observations: Observation groups of all robots, for their sizes.
    """
    return MLPModel(
        observations,
        OBSERVATION_GROUPS,
        "actor",
        quadruped.N_JOINTS,
        hidden_dims=ppo.actor_layers,
        distribution_cfg={"class_name": "GaussianDistribution", "init_std": ppo.initial_std},
    )


def act_by(actor: MLPModel, network: nn.Module) -> MLPModel:
    """Lets an actor's means be those of a network from observations (n, k) to actions (n, 12)."""
    setattr(actor, "mlp", network)  # noqa: B010
    return actor


class Learner:
    """Owns every learned number and every optimizer."""

    def __init__(
        self,
        config: TrainingConfig,
        observations: TensorDict,
        actor: MLPModel,
        estimator: StateEstimator | None = None,
    ) -> None:
        """
        Args:
            config: Settings.
            observations: Observation groups of all robots, for their sizes.
            actor: The policy that acts.
            estimator: The estimator that the environment observes with, if it learns too.
        """
        ppo = config.ppo
        self._config = ppo
        self._estimator = estimator
        self._estimator_trainer = estimator and EstimatorTrainer(estimator, config.estimator)
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

    def hold_actor(self, held: bool) -> None:
        """Lets the critic learn alone, or both."""
        self.ppo.actor.requires_grad_(not held)
        # An actor that is held does not diverge, which would raise the rate without end.
        self.ppo.schedule = "fixed" if held else "adaptive"

    def update(self, last_observations: TensorDict, number: int) -> dict[str, float]:
        """Learns from the stored steps and returns the losses by name.

        Args:
            last_observations: Observation groups after the last stored step.
            number: Updates done before this one.
        """
        ppo = self._config
        decay = np.interp(number, ppo.entropy_decay, (ppo.entropy, ppo.final_entropy))
        self.ppo.entropy_coef = float(decay)
        self.ppo.desired_kl = float(np.interp(number, ppo.kl_decay, (ppo.desired_kl, ppo.final_kl)))
        with torch.inference_mode():
            self.ppo.compute_returns(last_observations)
        stored = self.ppo.storage.observations.flatten(0, 1).clone()
        losses = self.ppo.update()
        if self._estimator_trainer is not None:
            losses["estimator"] = self._estimator_trainer.update(stored)
        losses["action_std"] = self.ppo.actor.output_std.mean().item()
        losses["learning_rate"] = self.ppo.learning_rate
        return losses

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Returns all that a checkpoint needs: named arrays, and values that JSON can hold."""
        arrays = {"torch_rng": torch.get_rng_state().numpy()}
        for name, module in self._modules().items():
            for key, value in module.state_dict().items():
                arrays[f"{name}/{key}"] = value.numpy().copy()
        for name, optimizer in self._optimizers().items():
            for index, slot in optimizer.state_dict()["state"].items():
                for key, value in slot.items():
                    arrays[f"{name}/{index}/{key}"] = value.numpy().copy()
        return arrays, {"learning_rate": self.ppo.learning_rate}

    def restore(self, arrays: dict[str, NDArray[Any]], values: dict[str, Any]) -> None:
        """Continues from what `to_arrays` returned."""
        tensors = {key: torch.from_numpy(value.copy()) for key, value in arrays.items()}
        for name, module in self._modules().items():
            module.load_state_dict({key: tensors[f"{name}/{key}"] for key in module.state_dict()})
        for name, optimizer in self._optimizers().items():
            state = optimizer.state_dict()
            for path, value in tensors.items():
                prefix, _, rest = path.partition("/")
                if prefix == name:
                    index, _, key = rest.partition("/")
                    state["state"].setdefault(int(index), {})[key] = value
            optimizer.load_state_dict(state)
        self.ppo.learning_rate = values["learning_rate"]
        for group in self.ppo.optimizer.param_groups:
            group["lr"] = values["learning_rate"]
        torch.set_rng_state(tensors["torch_rng"])

    def _modules(self) -> dict[str, nn.Module]:
        modules: dict[str, nn.Module] = {"actor": self.ppo.actor, "critic": self.ppo.critic}
        if self._estimator is not None:
            modules["estimator"] = self._estimator
        return modules

    def _optimizers(self) -> dict[str, torch.optim.Optimizer]:
        optimizers = {"ppo_optimizer": self.ppo.optimizer}
        if self._estimator_trainer is not None:
            optimizers["estimator_optimizer"] = self._estimator_trainer.optimizer
        return optimizers
