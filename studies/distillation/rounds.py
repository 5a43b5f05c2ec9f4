"""The rounds of a distillation: what acts, in which episodes, for how long (Algorithm 1)."""

import math
from dataclasses import dataclass

from glassgait.studies.distillation.config import DistillationConfig


@dataclass(frozen=True)
class Round:
    """Episodes that share a student and an alternation ratio, and are rolled out at once.

    Attributes:
        number: Number of the round, counted from 1.
        period: Control steps from one action of the expert to the next; 0 is never.
        episodes: Numbers of the episodes, counted from 1.
        steps: Control steps of an episode.
    """

    number: int
    period: int
    episodes: range
    steps: int


def rounds(config: DistillationConfig, kind: str) -> list[Round]:
    """Lists the rounds in which a student collects its samples.

    Args:
        config: Settings for a gait (see `DistillationConfig.for_gait`).
        kind: Kind of student.
    """
    size = config.episodes_per_fit or config.episodes_per_round
    planned = []
    for first in range(1, config.episodes + 1, size):
        episodes = range(first, min(first + size, config.episodes + 1))
        period = _period(config, math.ceil(first / config.episodes_per_round))
        planned.append(Round(len(planned) + 1, period, episodes, config.episode_steps))

    own = config.settings.of(kind).alone_episodes
    # What has its own number of episodes alone has them of full length.
    steps = config.alone_steps if own is None else config.episode_steps
    size = own or config.alone_episodes
    assert size is not None
    for first in range(config.episodes + 1, config.episodes + config.alone_rounds * size, size):
        planned.append(Round(len(planned) + 1, 0, range(first, first + size), steps))
    return planned


def _period(config: DistillationConfig, stage: int) -> int:
    if stage == 1:
        return 1
    return {"alternation": stage, "student_only": 0, "expert_only": 1, "half": 2}[config.curriculum]
