"""How thoroughly the report is made: in full, or in minutes."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from annotated_types import Ge, MinLen

from glassgait.models.settings import DISTINCT, FEW, Count, Natural, Settings
from glassgait.studies.common.rollouts.alternation import PERIODS
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.additive import EBM, EbmSettings
from glassgait.studies.distillation.students.boosting import (
    GBM,
    HISTOGRAM_GBM,
    GbmSettings,
    HistogramGbmSettings,
)
from glassgait.studies.distillation.students.registry import paper_students
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.symbolic import SYMBOLIC
from glassgait.studies.distillation.students.symbolic_regression import SymbolicSettings

PAPER_GAITS = ("walk", "trot", "pace", "bound")


@dataclass(frozen=True)
class ReportConfig(Settings):
    """How much is computed for each gait.

    Attributes:
        distillation: Settings of the distillation; the gait is set for each.
        periods: Control steps from one action of the expert to the next, at each of which students
            are rolled out; 0 is never.
        rollouts: How robots are rolled out.
        n_samples: Held-out samples that importances are measured on.
        repeats: Shuffles of each observation.
    """

    title: ClassVar[str] = "report"

    distillation: DistillationConfig = field(
        default_factory=lambda: DistillationConfig(students=paper_students())
    )
    periods: Annotated[tuple[Natural, ...], MinLen(1), FEW, DISTINCT] = PERIODS
    rollouts: RolloutConfig = field(default_factory=RolloutConfig)
    n_samples: Annotated[Count, Ge(2)] = 1000
    repeats: Count = 10


FULL = ReportConfig()
"""The paper's protocol, five seeds."""

QUICK = ReportConfig(
    distillation=DistillationConfig(
        students=paper_students(),
        episodes=8,
        episodes_per_round=2,
        alone_rounds=1,
        alone_episodes=2,
        alone_steps=500,
        episode_steps=500,
        settings=StudentsSettings(
            **{
                GBM.name: GbmSettings(n_trees=80, depth=4),
                HISTOGRAM_GBM.name: HistogramGbmSettings(n_trees=80),
                EBM.name: EbmSettings(outer_bags=2, interactions=40, round_interactions=20),
                SYMBOLIC.name: SymbolicSettings(shapes=((90, 90),), start_weights=(1,)),
            }
        ),
    ),
    rollouts=RolloutConfig(n_robots=13, n_steps=500, n_seeds=1),
    n_samples=400,
)
"""An eighth of the samples, small students, one seed of half as many robots for half as long."""
