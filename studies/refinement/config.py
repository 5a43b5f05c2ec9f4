"""The settings of a refinement: its command line and its record."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import tyro

from glassgait.diagrams.worlds import Worlds
from glassgait.models.settings import Count, Natural, Seed, Settings
from glassgait.studies.training.config import CurriculumConfig, PpoConfig, TrainingConfig

REFINING = PpoConfig(entropy=0.0, final_entropy=0.0, initial_std=0.15)
"""PPO of a policy that walks already: it looks about near to what it does."""

FULL_DEMANDS = CurriculumConfig(initial_difficulty=1.0)


@dataclass(frozen=True)
class RefinementConfig(Settings):
    """Settings of a refinement.

    Attributes:
        seed: Seed of all randomness.
        updates: Number of PPO updates.
        critic_updates: Updates at first in which the critic learns alone, since it begins anew.
        n_robots: Robots that walk at once.
        worlds: The worlds that they walk in.
        ppo: Settings of PPO.
    """

    title: ClassVar[str] = "refinement"

    seed: Seed = 0
    updates: Count = 150
    critic_updates: Natural = 10
    n_robots: Count = 256
    worlds: Annotated[Worlds, tyro.conf.arg(name="worlds")] = field(default_factory=Worlds)
    ppo: PpoConfig = REFINING

    def training(self, gait: str) -> TrainingConfig:
        """Returns the settings as those of a run that learns.

        Raises:
            InputError: if there are too few robots for an update, or for the worlds' groups.
        """
        return TrainingConfig(
            gait=gait,
            seed=self.seed,
            updates=self.updates,
            n_robots=self.n_robots,
            worlds=self.worlds,
            curriculum=FULL_DEMANDS,
            ppo=self.ppo,
        )
