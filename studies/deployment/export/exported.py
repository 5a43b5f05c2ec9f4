"""What every export does: it compares itself with Python, and writes its files."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.deployment.export.closed_loop import Maker, walk_both


@dataclass(frozen=True)
class Acting:
    """What is exported.

    Attributes:
        gait: The gait, whose reward machine runs.
        policy: The policy that acts: a student, or the expert.
        expert: Its estimator observes what no sensor measures.
        name: What the names of files begin with.
        policy_name: What the policy is called.
    """

    gait: Gait
    policy: Policy
    expert: NeuralPolicy
    name: str
    policy_name: str


@dataclass(frozen=True)
class Effort:
    """How much an export is compared with Python.

    Attributes:
        n_steps: Control steps, half of recorded and half of random sensors.
        n_robots: Robots that walk for 20 s in each engine; none if 0.
        seed: Seed of all randomness.
    """

    n_steps: int
    n_robots: int
    seed: int

    @property
    def n_recorded(self) -> int:
        """Control steps of recorded sensors."""
        return (self.n_steps + 1) // 2


class Exported(ABC):
    """A policy in another language, or several."""

    title: str
    """Name of the language."""

    @abstractmethod
    def check(self, effort: Effort) -> dict[str, pd.DataFrame]:
        """Compares itself with Python.

        Returns:
            Tables by their names: `agreement`, and `closed_loop` if robots walk.

        Raises:
            InputError: if it is not the same policy.
        """

    @abstractmethod
    def write(self, folder: Path) -> tuple[Path, ...]:
        """Writes its files, each of them whole or not at all, and returns their paths.

        Raises:
            InputError: if they cannot be written.
        """


class ExportedPolicy(Exported):
    """A policy of one gait in another language."""

    def __init__(self, acting: Acting) -> None:
        self.acting = acting

    def _walked(self, exported: Maker, effort: Effort) -> dict[str, pd.DataFrame]:
        """Lets robots walk, if any are to."""
        if not effort.n_robots:
            return {}
        say(f"robots that walk, moved by Python and by {self.title}: {effort.n_robots}")
        table = walk_both(
            self.acting.gait,
            self.acting.policy,
            self.acting.expert,
            exported,
            title=self.title,
            n_robots=effort.n_robots,
            n_steps=EPISODE_STEPS,
            seed=effort.seed,
        )
        return {"closed_loop": table}
