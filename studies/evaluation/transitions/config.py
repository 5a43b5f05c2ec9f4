"""How robots are rolled out that change their gait."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Le, MinLen

from glassgait.models.policies.switched import GREATEST_CHANGE
from glassgait.models.settings import (
    DISTINCT,
    FEW,
    Count,
    NotNegative,
    Positive,
    Seed,
    Settings,
    Share,
)
from glassgait.models.task.gait_switch import PATIENCE
from glassgait.studies.common.rollouts.seeds import REPORTED_SEEDS


@dataclass(frozen=True)
class TransitionConfig(Settings):
    """How robots are rolled out, and what eases the change.

    Attributes:
        speeds: Commanded forward speeds (m/s).
        n_robots: Robots of each pair of gaits and speed; the paper's 26.
        seed: Seed of initial states, dwells, instants of the request, and noise.
        patience: Multiple of the commanded steps in a state after which a gait is waited for no
            more; with 0 gaits change at once, whatever the feet do.
        greatest_change: Greatest squared change of the action in a control step.
        slowdown: Factor on the commanded speed from the request until a second after the change.
    """

    title: ClassVar[str] = "transitions"

    speeds: Annotated[tuple[Annotated[float, Ge(-3.0), Le(3.0)], ...], MinLen(1), FEW, DISTINCT] = (
        0.3,
        0.4,
        0.5,
    )
    n_robots: Count = 26
    seed: Seed = REPORTED_SEEDS[0]
    patience: NotNegative = PATIENCE
    greatest_change: Positive = GREATEST_CHANGE
    slowdown: Share = 1.0
