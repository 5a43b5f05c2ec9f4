"""What the demo does less of than the studies that it is made of, and what that costs."""

import math
from dataclasses import dataclass

from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.alternation import ratio_title
from glassgait.studies.common.cases import PERIODS
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.registry import STUDENTS


@dataclass(frozen=True)
class Reduction:
    """One thing that is smaller.

    Attributes:
        subject: What is smaller.
        full: How it is by default in `glassgait distill` and `glassgait evaluate worlds`.
        here: How it is here.
        loss: What is lost.
    """

    subject: str
    full: str
    here: str
    loss: str


def reductions(
    distillation: DistillationConfig, rollouts: RolloutConfig, periods: tuple[int, ...]
) -> tuple[Reduction, ...]:
    """Lists what is smaller, in the order of the road.

    Args:
        distillation: How the demo distils.
        rollouts: How it rolls out.
        periods: Its control steps from one action of the expert to the next.
    """
    full, usual = DistillationConfig(), RolloutConfig()
    left_out = [own.title for name, own in STUDENTS.items() if name not in distillation.students]
    return (
        Reduction(
            "samples",
            _samples(full),
            _samples(distillation),
            "imitation and return: with more samples all students come closer to the expert",
        ),
        Reduction(
            "what collects them",
            "each student its own",
            STUDENTS[distillation.collector].title + ", for all"
            if distillation.collector
            else "each student its own",
            "a student that does not collect has met none of its own mistakes before it walks "
            "alone, and R² is of states that it may never visit",
        ),
        Reduction(
            "students",
            f"{len(STUDENTS)} kinds, formulas the best of several sizes",
            f"{len(distillation.students)} kinds, smaller ensembles, formulas of one size",
            f"{', '.join(left_out) or 'no kind'} is not compared; ensembles could do better",
        ),
        Reduction(
            "robots",
            _robots(usual),
            _robots(rollouts),
            f"intervals are {_widening(usual, rollouts):.1f} times as wide; rare falls are missed",
        ),
        Reduction(
            "alternation ratios",
            _ratios(PERIODS),
            _ratios(periods),
            "the figure has fewer points between expert and alone",
        ),
    )


def _samples(config: DistillationConfig) -> str:
    seconds = config.episode_steps * CONTROL_PERIOD
    return (
        f"{config.episodes} episodes of {seconds:g} s, then {config.alone_rounds} rounds in which "
        "the student acts alone"
    )


def _robots(config: RolloutConfig) -> str:
    seeds = "one seed" if config.n_seeds == 1 else f"each of {config.n_seeds} seeds"
    return f"{config.n_robots} of {seeds}, for {config.n_steps * CONTROL_PERIOD:g} s"


def _widening(usual: RolloutConfig, here: RolloutConfig) -> float:
    """Returns how much wider intervals are: they shrink by the root of the number of robots."""
    robots = usual.n_robots * usual.n_seeds, here.n_robots * here.n_seeds
    return math.sqrt(robots[0] / robots[1])


def _ratios(periods: tuple[int, ...]) -> str:
    return ", ".join(map(ratio_title, periods))
