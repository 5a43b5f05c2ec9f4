"""Settings of a refinement, and the scenarios that formulas learn on in."""

from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
import tyro

from glassgait.diagrams.domain_randomization import (
    HARSH,
    DomainRandomization,
    GroupRanges,
    TerrainRanges,
)
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.settings import Count, Seed, Settings, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.studies.training.config import CurriculumConfig, PpoConfig, TrainingConfig

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

FULL_DEMANDS = CurriculumConfig(initial_difficulty=1.0, initial_hardship=1.0)
"""No curriculum: the whole dwell, clearance, pushes and ground from the first update on."""


@checked
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
