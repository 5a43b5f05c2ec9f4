"""The refinement study: formulas that walk learn to walk better, their numbers alone."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from tensordict import TensorDict
from torch import nn

from glassgait.models.arrays import Array
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.common.rollouts import distilled_speeds
from glassgait.studies.common.selection import rank_alone, simplest_of_the_best
from glassgait.studies.common.tables import write_table
from glassgait.studies.distillation.refinement.config import RefinementConfig
from glassgait.studies.distillation.refinement.formula_network import FormulaNetwork
from glassgait.studies.distillation.students.formula_fit import short_numbers
from glassgait.studies.training.environment import TrainingEnvironment
from glassgait.studies.training.learner import Learner, act_by, gaussian_actor
from glassgait.studies.training.learning_run import LearningRun
from glassgait.studies.training.record import write_learned

SEEN_STEPS = 50
"""Control steps that robots walk before the run, to see what each number does."""

N_BALANCED = 512
"""Observations of these that the numbers' units are set by."""


class RefinementRun(LearningRun):
    """A refinement in its folder."""

    def __init__(
        self,
        config: RefinementConfig,
        gait: Gait,
        expert: NeuralPolicy,
        policy: FormulaPolicy,
        folder: Path,
        *,
        name: str,
        resume: bool = False,
    ) -> None:
        """
        Args:
            config: Settings; a resumed run must have the same, except for more updates.
            gait: The gait.
            expert: The expert; its estimator, which no longer learns, observes for the policy.
            policy: The policy to begin with.
            folder: Where policy, checkpoint, curve and TensorBoard events go.
            name: What the policy's file is called.
            resume: Whether to continue from the folder's checkpoint.

        Raises:
            InputError: if there is nothing to resume, or it is damaged.
        """
        self._refinement = config
        self._expert = expert
        self._policy = policy
        self._name = name
        limited = alone(policy, expert).limits_targets
        robot = policy.robot.source
        training = config.training(gait.name, robot=robot, limit_targets=limited)
        super().__init__(training, gait, folder, resume=resume)

    def update(self) -> dict[str, float]:
        """Collects one batch of steps, learns from it, and returns the row of the curve."""
        self.learner.hold_actor(self.progress.update < self._refinement.critic_updates)
        row = super().update()
        count = self._refinement.n_terms(self.progress.update, len(self._network.start))
        if count < self._network.n_numbers:
            stored = self.learner.ppo.storage.observations.flatten(0, 1)
            index = torch.randperm(len(stored))[:N_BALANCED]
            self._network.prune(count, _seen(stored[index]))
        row["terms"] = float(self._network.n_numbers)
        if self._refinement.is_candidate(self.progress.update, self._network.n_numbers):
            self.policy().save(self._candidate(self.progress.update))
        return row

    def policy(self) -> FormulaPolicy:
        """Returns the policy as it is now, with the digits that its file shows."""
        return short_numbers(self._network.to_policy())

    def write_result(self) -> None:
        """Writes formulas, record and curve: the formulas as they are now, and in the end the best.

        Noise and worlds of learning say little of how formulas walk alone, and more learning may
        make them worse. So the candidates walk alone, and the best of them is the result.
        """
        finished = self.progress.update >= self.config.updates
        best = self._best_candidate() if finished else self.policy()
        write_learned(best, self._name, self.config, self.progress, self.folder)

    def _best_candidate(self) -> Policy:
        candidates: dict[str, Policy] = {
            f"update {update}": load_policy(self._candidate(update))
            for update in range(1, self.progress.update + 1)
            if self._candidate(update).exists()
        }
        if self._refinement.is_candidate(0, self._policy.n_terms()):
            candidates["as they were"] = self._policy
        say(f"letting {len(candidates)} candidates walk alone, to choose one")
        n_steps = self._refinement.candidate_steps
        ranked = rank_alone(candidates, self.gait, self._expert, n_steps)
        # Of those that fall least the one that earns most, however short the others are.
        places = {label: place for place, label in enumerate(ranked["candidate"])}
        chosen = simplest_of_the_best(ranked, places)
        write_table(ranked.assign(chosen=ranked["candidate"] == chosen), self.folder / "candidates")
        return candidates[chosen]

    def _candidate(self, update: int) -> Path:
        return self.folder / "candidates" / f"update_{update}{self._policy.suffix}"

    def _begin(self) -> tuple[TrainingEnvironment, Learner]:
        estimator = _Frozen(self._expert.estimator)
        generator = np.random.default_rng(self.config.seed)
        # Commanded to go as the students of a distillation: few terms cannot serve every speed.
        speeds = distilled_speeds(self.gait)
        environment = TrainingEnvironment(self.config, self.gait, estimator, generator, speeds)
        self._network = FormulaNetwork(self._policy)
        self._network.balance(self._visited(environment, generator))
        observations = environment.observe()
        actor = act_by(gaussian_actor(self.config.ppo, observations), self._network)
        return environment, Learner(self.config, observations, actor)

    def _visited(
        self, environment: TrainingEnvironment, generator: np.random.Generator
    ) -> torch.Tensor:
        """Lets the policy walk, and returns some of what it observed (m, n_observations)."""
        seen = []
        with torch.inference_mode():
            for _ in range(SEEN_STEPS):
                observed = environment.observe()
                seen.append(_seen(observed))
                environment.step(self._network(seen[-1]))
        every = torch.cat(seen)
        return every[generator.permutation(len(every))[:N_BALANCED]].clone()

    def _inputs(self) -> tuple[str, ...]:
        return self._expert.digest(), self._policy.digest()


def _seen(observations: TensorDict) -> torch.Tensor:
    """Returns what the policy observes (n, n_observations)."""
    return torch.cat([observations["proprioception"], observations["estimate"]], dim=1)


class _Frozen(nn.Module):
    """An expert's estimator, as its robots are deployed with it."""

    def __init__(self, estimator: Callable[[Array], Array]) -> None:
        super().__init__()
        self._estimator = estimator

    def forward(self, proprioception: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(self._estimator(proprioception.numpy().astype(float))).float()
