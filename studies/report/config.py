"""How thoroughly the report is made: in full, or in minutes."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from annotated_types import Ge

from glassgait.models.settings import Count, Settings
from glassgait.studies.distillation.config import (
    DistillationConfig,
    EbmConfig,
    GbmConfig,
    HistogramGbmConfig,
    StudentKind,
    SymbolicConfig,
)
from glassgait.studies.rollouts.config import RolloutConfig

PAPER_STUDENTS: tuple[StudentKind, ...] = ("gbm", "ebm", "symbolic")
"""The students of the paper's tables and figures."""

PAPER_GAITS = ("walk", "trot", "pace", "bound")


@dataclass(frozen=True)
class ReportConfig(Settings):
    """How much is computed for each gait.

    Attributes:
        distillation: Settings of the distillation; the gait is set for each.
        rollouts: How robots are rolled out.
        n_samples: Held-out samples that importances are measured on.
        repeats: Shuffles of each observation.
    """

    title: ClassVar[str] = "report"

    distillation: DistillationConfig = field(
        default_factory=lambda: DistillationConfig(students=PAPER_STUDENTS)
    )
    rollouts: RolloutConfig = field(default_factory=RolloutConfig)
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10


FULL = ReportConfig()
"""The paper's protocol, five seeds."""

QUICK = ReportConfig(
    distillation=DistillationConfig(
        students=PAPER_STUDENTS,
        episodes=8,
        episodes_per_level=2,
        alone_levels=1,
        alone_episodes=2,
        alone_steps=500,
        episode_steps=500,
        gbm=GbmConfig(n_trees=80, depth=4),
        histogram_gbm=HistogramGbmConfig(n_trees=80),
        ebm=EbmConfig(outer_bags=2, interactions=40, level_interactions=20),
        symbolic=SymbolicConfig(shapes=((90, 90),), start_weights=(1,)),
    ),
    rollouts=RolloutConfig(n_robots=13, n_steps=500, n_seeds=1),
    n_samples=400,
)
"""An eighth of the samples, small students, one seed of half as many robots for half as long."""
