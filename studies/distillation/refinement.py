"""Refinement: PPO adjusts the numbers of formulas while robots walk by them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from tensordict import TensorDict

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.common.tables import write_table
from glassgait.studies.distillation.config import RefinementConfig
from glassgait.studies.distillation.formula_network import FormulaNetwork
from glassgait.studies.distillation.formulas import short_numbers
from glassgait.studies.distillation.selection import rank_candidates, simplest_of_the_best
from glassgait.studies.training.environment import Environment, actor_observations
from glassgait.studies.training.learner import Learner, gaussian_actor, set_network
from glassgait.studies.training.run import LearningRun

BALANCE_STEPS = 50
"""Control steps that robots walk before the run, to measure the effect of each number."""

N_BALANCED = 512
"""Observations, sampled from these steps, from which the numbers' units are computed."""


class RefinementRun(LearningRun):
    """A refinement, whose files are in one folder."""

    def __init__(
        self,
        config: RefinementConfig,
        gait: Gait,
        expert: Policy,
        policy: FormulaPolicy,
        folder: Path,
        *,
        name: str,
        resume: bool = False,
    ) -> None:
        """Begins a run, or continues the one in the folder.

        Raises:
            InputError: if the checkpoint is damaged, or the policy was made for another reward
                machine, has numbers that are not weights, or returns targets that are not finite.
        """
        policy.refuse_other_machine(gait)
        self._refinement, self._expert, self._policy, self._name = config, expert, policy, name
        self._file_name = f"{name}{policy.suffix}"
        law = alone(policy, expert).joint_law
        training = config.training(gait.name, policy.robot.source, law)
        super().__init__(training, gait, folder, resume=resume)

    def update(self) -> dict[str, float]:
        row, every = super().update(), self._refinement.candidate_updates
        if self.n_updates % every == 0 or self.n_updates == self.config.updates:
            # A resumed run has the same candidates.
            self.policy().save(self._candidate(self.n_updates))
        return row

    def policy(self) -> FormulaPolicy:
        """Returns the current policy, with numbers rounded as in its file."""
        try:
            policy = short_numbers(self._network.to_policy())
        except InputError as error:
            raise InputError(f"{self._file_name}: {error}") from error
        return policy.with_estimator_of(self._expert)

    def write_result(self) -> None:
        """Writes the record, the curve and the formulas; at the end, the best candidate's."""
        # Training returns include exploration noise and hardly predict how formulas walk, and more
        # updates may make them worse. So the candidates are compared by rollouts.
        finished = self.n_updates >= self.config.updates
        best = self._best_candidate() if finished else self.policy()
        self._write_policy(best, self._name, self._refinement)

    def _best_candidate(self) -> Policy:
        # The saved candidates, and the initial formulas.
        candidates: dict[str, Policy] = {
            f"update {update}": load_policy(self._candidate(update))
            for update in range(1, self.n_updates + 1)
            if self._candidate(update).exists()
        }
        candidates["as they were"] = self._policy
        say(f"letting {len(candidates)} candidates walk, to choose one")
        n_steps = self._refinement.candidate_steps
        ranked = rank_candidates(candidates, self.gait, self._expert, n_steps)
        # Ranks instead of complexities: lengths do not matter here, only falls and return.
        ranks = {label: rank for rank, label in enumerate(ranked["candidate"])}
        chosen = simplest_of_the_best(ranked, ranks)
        write_table(ranked.assign(chosen=ranked["candidate"] == chosen), self.folder / "candidates")
        return candidates[chosen]

    def _candidate(self, update: int) -> Path:
        return self.folder / "candidates" / f"update_{update}{self._policy.suffix}"

    def _begin(self) -> tuple[Environment, Learner]:
        # The expert's estimator is not trained further.
        estimator = self._expert.estimator
        assert estimator is not None  # An expert has one.
        if not isinstance(estimator, Odometry):
            estimator = _in_torch(estimator)
        generator = np.random.default_rng(self.config.seed)
        imu = self._policy.layout.imu
        environment = Environment(self.config, self.gait, estimator, generator, observes_imu=imu)
        self._network = FormulaNetwork(self._policy, self._file_name)
        # Refuse formulas that cannot be written before the run writes any file.
        self.policy()

        # Compute the units of the numbers from visited states, and give the network to PPO.
        self._network.balance(self._visited(environment, generator))
        observations = environment.observe()
        actor = set_network(gaussian_actor(self.config.ppo, observations), self._network)
        return environment, Learner(self.config, observations, actor)

    def _visited(self, environment: Environment, generator: np.random.Generator) -> torch.Tensor:
        """Rolls out the policy, and returns some of its observations (m, n_observations)."""

        def act(observations: TensorDict) -> torch.Tensor:
            return self._network(actor_observations(observations))

        with torch.inference_mode():
            steps = environment.play(act, BALANCE_STEPS)
            observations = torch.cat([actor_observations(observed) for observed, _ in steps])
        return observations[generator.permutation(len(observations))[:N_BALANCED]].clone()


def _in_torch(estimator: Callable[[Array], Array]) -> Callable[[torch.Tensor], torch.Tensor]:
    def estimate(proprioception: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(estimator(proprioception.numpy().astype(float))).float()

    return estimate
