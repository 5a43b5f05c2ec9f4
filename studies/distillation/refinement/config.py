"""The settings of a refinement: its command line and its record."""

from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
import tyro

from glassgait.diagrams.domain_randomization import HARSH, DomainRandomization, GroupRanges
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.settings import Count, Natural, Seed, Settings
from glassgait.models.task import EPISODE_STEPS
from glassgait.studies.training.config import CurriculumConfig, PpoConfig, TrainingConfig

REFINING = PpoConfig(entropy=0.0, final_entropy=0.0, initial_std=0.1)
"""PPO of a policy that walks already: it looks about near to what it does."""

PRUNING_SHARE = 2 / 3
"""Share of the updates after which no more terms are dropped."""

MILD = DomainRandomization(
    groups=GroupRanges(payload=(0.0, 1.0), motor_strength=(0.9, 1.1), gains=(0.9, 1.1)),
    fine_steps=(),
    randomization=replace(HARSH, push_speed=0.5, latency=(0.0, 0.01)),
)
"""About half of what experts meet: few terms that learn in the harshest worlds forget home."""

FULL_DEMANDS = CurriculumConfig(initial_difficulty=1.0)


@dataclass(frozen=True)
class RefinementConfig(Settings):
    """Settings of a refinement.

    Attributes:
        seed: Seed of all randomness.
        updates: Number of PPO updates.
        terms: Terms of all formulas together that are left in the end; all by default.
        critic_updates: Updates at first in which the critic learns alone, since it begins anew.
        candidate_updates: Updates from one candidate to the next: the formulas that there are then
            walk alone, and those that do best are the result.
        candidate_steps: Control steps that each of a candidate's robots walks.
        n_robots: Robots that walk at once.
        worlds: The randomised scenarios that they walk in.
        ppo: Settings of PPO.
    """

    title: ClassVar[str] = "refinement"

    seed: Seed = 0
    updates: Count = 150
    terms: Count | None = None
    critic_updates: Natural = 10
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
            at_first: Terms at first.
        """
        if self.terms is None:
            return at_first
        span = PRUNING_SHARE * self.updates - self.critic_updates
        left = 1.0 - np.clip((update - self.critic_updates) / max(span, 1.0), 0.0, 1.0)
        return min(at_first, self.terms + round((at_first - self.terms) * float(left) ** 3))

    def is_candidate(self, update: int, n_terms: int) -> bool:
        """Returns whether the formulas after an update may be the result.

        Args:
            update: Updates done; 0 for the formulas that the run begins with.
            n_terms: Terms that they have.
        """
        due = update % self.candidate_updates == 0 or update == self.updates
        return due and (self.terms is None or n_terms <= self.terms)

    def training(
        self, gait: str, *, robot: str = DEFAULT_ROBOT, limit_targets: bool = False
    ) -> TrainingConfig:
        """Returns the settings as those of a run that learns.

        Args:
            gait: Name of the gait.
            robot: Name of the robot, or path of its robot.yaml.
            limit_targets: Whether joints follow targets within their ranges alone.

        Raises:
            InputError: if there are too few robots for an update, or for the worlds' groups.
        """
        return TrainingConfig(
            gait=gait,
            robot=robot,
            seed=self.seed,
            updates=self.updates,
            n_robots=self.n_robots,
            worlds=self.worlds,
            limit_targets=limit_targets,
            curriculum=FULL_DEMANDS,
            ppo=self.ppo,
        )
