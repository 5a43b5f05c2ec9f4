"""`glassgait refine`: a policy of formulas learns on in closed loop; only its numbers change."""

from collections.abc import Callable
from dataclasses import field, replace
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
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_policy, policy_path
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.settings import Count, Seed, Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.run import CHECKPOINT_NAME, open_run
from glassgait.studies.common.tables import write_table
from glassgait.studies.distillation.formula_network import FormulaNetwork
from glassgait.studies.distillation.formulas import short_numbers
from glassgait.studies.distillation.selection import rank_alone, simplest_of_the_best
from glassgait.studies.distillation.students import OnePolicy
from glassgait.studies.training.config import CurriculumConfig, PpoConfig, TrainingConfig
from glassgait.studies.training.environment import Environment, observed_by_actor
from glassgait.studies.training.learner import Learner, act_by, gaussian_actor
from glassgait.studies.training.run import LearningRun

SEEN_STEPS = 50
"""Control steps that robots walk before the run, to see the effect of each number."""

N_BALANCED = 512
"""Observations of these steps from which the numbers' units are set."""

REFINING = PpoConfig(critic_updates=10, entropy=0.0, final_entropy=0.0, initial_std=0.1)
"""PPO of a policy that walks already: it explores close to its actions."""

MILD = DomainRandomization(
    groups=GroupRanges(
        payload=(0.0, 2.5),
        motor_strength=(0.9, 1.1),
        gains=(0.9, 1.1),
        terrains=TerrainRanges(slope=12.5, amplitude=0.035, height=0.035),
    ),
    randomization=replace(HARSH, push_speed=1.2, latency=(0.0, 0.015)),
)
"""About half of what experts meet: in the harshest scenarios few terms forget level ground."""

FULL_DEMANDS = CurriculumConfig(initial_difficulty=1.0, initial_hardship=1.0)
"""No curriculum: the whole dwell, clearance, pushes and ground from the first update on."""


@checked
class RefinementConfig(Settings):
    """Settings of a refinement.

    Attributes:
        seed: Seed of all randomness.
        updates: Number of PPO updates.
        candidate_updates: Updates from one candidate to the next, and from one checkpoint to the
            next. Candidates are formulas that walk without the expert at the end of the run; the
            best of them are the result.
        candidate_steps: Control steps that each of a candidate's robots walks.
        n_robots: Robots that walk at once.
        worlds: The randomised scenarios that they walk in.
        ppo: Settings of PPO.
    """

    title: ClassVar[str] = "refinement"

    seed: Seed = 0
    updates: Count = 150
    candidate_updates: Count = 20
    candidate_steps: Count = EPISODE_STEPS
    n_robots: Count = 256
    worlds: Annotated[DomainRandomization, tyro.conf.arg(name="worlds")] = MILD
    ppo: PpoConfig = REFINING

    def training(self, gait: str, robot: str, law: JointLaw) -> TrainingConfig:
        """Returns the settings of the run that learns.

        Raises:
            InputError: if there are too few robots for an update, or for the worlds' groups.
        """
        station = self.worlds.station.with_gains(load_robot(robot), law)
        return TrainingConfig(
            robot=robot,
            worlds=replace(self.worlds, station=station),
            limit_targets=law.limited,
            curriculum=FULL_DEMANDS,
            gait=gait,
            seed=self.seed,
            updates=self.updates,
            checkpoint_updates=self.candidate_updates,
            n_robots=self.n_robots,
            ppo=self.ppo,
        )


@checked
class Refine(OnePolicy):
    """Let a policy of formulas learn on in closed loop, by PPO; only its numbers change.

    Attributes:
        config: Settings of the run.
        output: Folder of the run; runs/refine/<gait>/<policy> by default.
        resume: Continue the run that the folder holds.
    """

    title: ClassVar[str] = "refine"

    config: Annotated[RefinementConfig, tyro.conf.arg(name="")] = field(
        default_factory=RefinementConfig
    )
    output: Path | None = None
    resume: bool = False

    def run(self) -> None:
        """Runs the study."""
        found, named = self.find()
        # Where there is no expert, the second says so.
        policy, expert = found.formulas(named), found.expert_of(named) or found.expert
        gait, name = found.gait, Path(named).stem
        folder = self.output or found.output(self.title) / name
        with open_run(
            folder,
            study=self.title,
            settings=self.config,
            inputs={"gait": gait.digest(), "policy": policy.digest(), "expert": expert.digest()},
            resume=self.resume,
            free=("updates",),
        ):
            begun = (folder / CHECKPOINT_NAME).exists()
            run = RefinementRun(self.config, gait, expert, policy, folder, name=name, resume=begun)
            # The formulas observe by its estimator, wherever the folder is moved.
            expert.save(policy_path(folder, EXPERT))
            run.run()
        console.print(f"formulas written to {folder / name}{policy.suffix}")


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
            name: Name of the policy's file.
            resume: Whether to continue from the folder's checkpoint.

        Raises:
            InputError: if there is nothing to resume, or it is damaged; or the policy was made for
                another machine than the gait's, holds numbers that are not weights of terms, or is
                not finite where robots walk.
        """
        policy.refuse_other_machine(gait)
        self._refinement = config
        self._expert = expert
        self._policy = policy
        self._name = name
        law = alone(policy, expert).joint_law
        training = config.training(gait.name, policy.robot.source, law)
        super().__init__(training, gait, folder, resume=resume)

    def update(self) -> dict[str, float]:
        """Collects one batch of steps, learns from it, and returns the row of the curve."""
        row = super().update()
        if self._is_candidate(self.n_updates):
            self.policy().save(self._candidate(self.n_updates))
        return row

    def policy(self) -> FormulaPolicy:
        """Returns the policy as it is now, with the digits that its file shows.

        Raises:
            InputError: if formulas may not hold a number, such as one that is too great.
        """
        try:
            policy = short_numbers(self._network.to_policy())
        except InputError as error:
            raise InputError(f"{self._file_name}: {error}") from error
        return policy.with_estimator_of(self._expert)

    def write_result(self) -> None:
        """Writes formulas, record and curve: the current formulas, and in the end the best.

        Noise and worlds of learning say little of how formulas walk without the expert, and more
        learning may make them worse. So the candidates walk, and the best of them is the result.
        """
        finished = self.n_updates >= self.config.updates
        best = self._best_candidate() if finished else self.policy()
        self._write_learned(best, self._name, self._refinement)

    def _best_candidate(self) -> Policy:
        # Those that the run kept, and the formulas that it began with.
        candidates: dict[str, Policy] = {
            f"update {update}": load_policy(self._candidate(update))
            for update in range(1, self.n_updates + 1)
            if self._candidate(update).exists()
        }
        candidates["as they were"] = self._policy
        say(f"letting {len(candidates)} candidates walk, to choose one")
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

    def _is_candidate(self, update: int) -> bool:
        return update % self._refinement.candidate_updates == 0 or update == self.config.updates

    def _candidate(self, update: int) -> Path:
        return self.folder / "candidates" / f"update_{update}{self._policy.suffix}"

    def _begin(self) -> tuple[Environment, Learner]:
        # The expert's estimator no longer learns.
        estimator = self._expert.estimator
        if not isinstance(estimator, Odometry):
            estimator = _Frozen(estimator)
        generator = np.random.default_rng(self.config.seed)
        imu = self._policy.layout.imu
        environment = Environment(self.config, self.gait, estimator, generator, observes_imu=imu)
        self._network = FormulaNetwork(self._policy, self._file_name)
        # Written at once, what cannot be written is refused before the run has made anything.
        self.policy()

        # Set the units of the numbers where the policy walks, and let PPO act by them.
        self._network.balance(self._visited(environment, generator))
        observations = environment.observe()
        actor = act_by(gaussian_actor(self.config.ppo, observations), self._network)
        return environment, Learner(self.config, observations, actor)

    def _visited(self, environment: Environment, generator: np.random.Generator) -> torch.Tensor:
        """Lets the policy walk, and returns some of its observations (m, n_observations)."""

        def act(observations: TensorDict) -> torch.Tensor:
            return self._network(observed_by_actor(observations))

        with torch.inference_mode():
            seen = [
                observed_by_actor(observed) for observed, _ in environment.play(act, SEEN_STEPS)
            ]
        every = torch.cat(seen)
        return every[generator.permutation(len(every))[:N_BALANCED]].clone()


class _Frozen(nn.Module):
    """An expert's estimator, as its robots are deployed with it."""

    def __init__(self, estimator: Callable[[Array], Array]) -> None:
        super().__init__()
        self._estimator = estimator

    def forward(self, proprioception: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(self._estimator(proprioception.numpy().astype(float))).float()
