"""The refinement study: formulas that walk learn to walk better, their numbers alone."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
import torch
import tyro
from tensordict import TensorDict
from torch import nn

from glassgait.diagrams.domain_randomization import (
    HARSH,
    DomainRandomization,
    GroupRanges,
    TerrainRanges,
)
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.settings import Count, Seed, Settings
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.odometry import Odometry
from glassgait.studies.common.console import say
from glassgait.studies.common.selection import rank_alone, simplest_of_the_best
from glassgait.studies.common.tables import write_table
from glassgait.studies.distillation.learning_on import learning_on
from glassgait.studies.distillation.refinement.formula_network import FormulaNetwork
from glassgait.studies.distillation.students.symbolic import short_numbers
from glassgait.studies.training.config import PpoConfig, TrainingConfig
from glassgait.studies.training.environment import TrainingEnvironment, observed_by_actor
from glassgait.studies.training.learner import Learner, act_by, gaussian_actor
from glassgait.studies.training.learning_run import LearningRun
from glassgait.studies.training.record import write_learned

REFINING = PpoConfig(critic_updates=10, entropy=0.0, final_entropy=0.0, initial_std=0.1)
"""PPO of a policy that walks already: it looks about near to what it does."""

PRUNING_SHARE = 2 / 3
"""Share of the updates after which no more terms are dropped."""

MILD = DomainRandomization(
    groups=GroupRanges(
        payload=(0.0, 2.5),
        motor_strength=(0.9, 1.1),
        gains=(0.9, 1.1),
        terrains=TerrainRanges(slope=12.5, amplitude=0.035, height=0.035),
    ),
    randomization=replace(HARSH, push_speed=1.2, latency=(0.0, 0.015)),
)
"""About half of what experts meet: few terms that learn in the harshest worlds forget home."""


@dataclass(frozen=True)
class RefinementConfig(Settings):
    """Settings of a refinement.

    Attributes:
        seed: Seed of all randomness.
        updates: Number of PPO updates.
        terms: Terms of all formulas together that are left in the end; all by default.
        candidate_updates: Updates from one candidate to the next, and from one checkpoint to the
            next: the formulas that there are then walk alone, and those that do best are the
            result.
        candidate_steps: Control steps that each of a candidate's robots walks.
        n_robots: Robots that walk at once.
        worlds: The randomised scenarios that they walk in.
        ppo: Settings of PPO.
    """

    title: ClassVar[str] = "refinement"

    seed: Seed = 0
    updates: Count = 150
    terms: Count | None = None
    candidate_updates: Count = 20
    candidate_steps: Count = EPISODE_STEPS
    n_robots: Count = 256
    worlds: Annotated[DomainRandomization, tyro.conf.arg(name="worlds")] = MILD
    ppo: PpoConfig = REFINING

    def n_terms(self, update: int, at_first: int) -> int:
        """Returns how many terms are left after an update.

        Many go early, and the last ones slowly (the cubic schedule of Zhu and Gupta, «To prune, or
        not to prune», 2017). The last third of the updates has the terms that are left.

        Args:
            update: Updates done.
        """
        if self.terms is None:
            return at_first
        first = self.ppo.critic_updates
        span = PRUNING_SHARE * self.updates - first
        left = 1.0 - np.clip((update - first) / max(span, 1.0), 0.0, 1.0)
        return min(at_first, self.terms + round((at_first - self.terms) * float(left) ** 3))

    def is_candidate(self, update: int, n_terms: int) -> bool:
        """Returns whether the formulas after an update may be the result.

        Args:
            update: Updates done; 0 for the formulas that the run begins with.
        """
        due = update % self.candidate_updates == 0 or update == self.updates
        return due and (self.terms is None or n_terms <= self.terms)

    def training(
        self, gait: str, *, robot: str = DEFAULT_ROBOT, law: JointLaw = OWN_LAW
    ) -> TrainingConfig:
        """Returns the settings as those of a run that learns.

        Args:
            robot: Name of the robot, or path of its robot.yaml.
            law: How joints follow targets; the robot's own way by default.

        Raises:
            InputError: if there are too few robots for an update, or for the worlds' groups.
        """
        return learning_on(
            self.worlds,
            robot=robot,
            law=law,
            gait=gait,
            seed=self.seed,
            updates=self.updates,
            checkpoint_updates=self.candidate_updates,
            n_robots=self.n_robots,
            ppo=self.ppo,
        )


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
            expert: The expert; its estimator, which no longer learns, observes for the policy.
            policy: The policy to begin with.
            folder: Where policy, checkpoint, curve and TensorBoard events go.
            name: What the policy's file is called.
            resume: Whether to continue from the folder's checkpoint.

        Raises:
            InputError: if there is nothing to resume, or it is damaged, or the policy was made for
                another machine than the gait's, or is not finite where robots walk.
        """
        policy.refuse_other_machine(gait)
        self._refinement = config
        self._expert = expert
        self._policy = policy
        self._name = name
        law, robot = alone(policy, expert).joint_law, policy.robot.source
        training = config.training(gait.name, robot=robot, law=law)
        super().__init__(training, gait, folder, resume=resume)

    def update(self) -> dict[str, float]:
        """Collects one batch of steps, learns from it, and returns the row of the curve."""
        row = super().update()
        count = self._refinement.n_terms(self.progress.update, len(self._network.start))
        if count < self._network.n_numbers:
            stored = self.learner.ppo.storage.observations.flatten(0, 1)
            index = torch.randperm(len(stored))[:N_BALANCED]
            self._network.prune(count, observed_by_actor(stored[index]))
        row["terms"] = float(self._network.n_numbers)
        if self._refinement.is_candidate(self.progress.update, self._network.n_numbers):
            self.policy().save(self._candidate(self.progress.update))
        return row

    def policy(self) -> FormulaPolicy:
        """Returns the policy as it is now, with the digits that its file shows.

        Raises:
            InputError: if it holds what formulas may not, such as a number that is too great.
        """
        try:
            policy = short_numbers(self._network.to_policy())
        except InputError as error:
            raise InputError(f"{self._file_name}: {error}") from error
        return policy.with_estimator_of(self._expert)

    def write_result(self) -> None:
        """Writes formulas, record and curve: the formulas as they are now, and in the end the best.

        Noise and worlds of learning say little of how formulas walk alone, and more learning may
        make them worse. So the candidates walk alone, and the best of them is the result.
        """
        finished = self.progress.update >= self.config.updates
        best = self._best_candidate() if finished else self.policy()
        write_learned(
            best, self._name, self.config, self.progress, self.folder, study=self._refinement
        )

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

    @property
    def _file_name(self) -> str:
        return f"{self._name}{self._policy.suffix}"

    def _candidate(self, update: int) -> Path:
        return self.folder / "candidates" / f"update_{update}{self._policy.suffix}"

    def _begin(self) -> tuple[TrainingEnvironment, Learner]:
        own = self._expert.estimator
        estimator = own if isinstance(own, Odometry) else _Frozen(own)
        generator = np.random.default_rng(self.config.seed)
        environment = TrainingEnvironment(
            self.config,
            self.gait,
            estimator,
            generator,
            observes_imu=self._policy.layout.imu,
        )
        self._network = FormulaNetwork(self._policy, self._file_name)
        # Written at once, what cannot be written is refused before the run has made anything.
        self.policy()
        self._network.balance(self._visited(environment, generator))
        observations = environment.observe()
        actor = act_by(gaussian_actor(self.config.ppo, observations), self._network)
        return environment, Learner(self.config, observations, actor)

    def _visited(
        self, environment: TrainingEnvironment, generator: np.random.Generator
    ) -> torch.Tensor:
        """Lets the policy walk, and returns some of what it observed (m, n_observations)."""

        def act(observations: TensorDict) -> torch.Tensor:
            return self._network(observed_by_actor(observations))

        with torch.inference_mode():
            seen = [
                observed_by_actor(observed) for observed, _ in environment.play(act, SEEN_STEPS)
            ]
        every = torch.cat(seen)
        return every[generator.permutation(len(every))[:N_BALANCED]].clone()

    def _inputs(self) -> tuple[str, ...]:
        return self._expert.digest(), self._policy.digest()


class _Frozen(nn.Module):
    """An expert's estimator, as its robots are deployed with it."""

    def __init__(self, estimator: Callable[[Array], Array]) -> None:
        super().__init__()
        self._estimator = estimator

    def forward(self, proprioception: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(self._estimator(proprioception.numpy().astype(float))).float()
