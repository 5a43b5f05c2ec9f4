"""Reward against alternation ratio, for the expert and every student (paper, Figure 2)."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import pandas as pd

from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from models.task.gait import Gait
from studies.evaluation.config import DISTILLED_SPEEDS, WORLDS, RolloutConfig
from studies.evaluation.rollouts import Team, roll_out
from studies.evaluation.scores import score_rollouts

PERIODS = (1, 2, 4, 6, 8, 0)
"""Control steps from one action of the expert to the next: ratios 1, 1/2, 1/4, 1/6, 1/8 and 0."""


def ratio_title(period: int) -> str:
    """Writes a period as the paper's alternation ratio."""
    return {0: "0", 1: "1"}.get(period, f"1/{period}")


def evaluate_alternation(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    config: RolloutConfig,
    report: Callable[[str], None],
    periods: tuple[int, ...] = PERIODS,
) -> pd.DataFrame:
    """Rolls out every student at every ratio.

    All meet the same initial states, commands and noise. At ratio 1 the expert acts alone, so it
    is rolled out once.

    Returns:
        Scores, a row a robot, with the columns `policy` and `ratio`.
    """
    if config.speed_range is None:
        config = replace(config, speed_range=DISTILLED_SPEEDS)
    tables = []
    teams = {("expert", 1): Team(expert)}
    for kind, student in students.items():
        for period in periods:
            if period != 1:
                teams[kind, period] = Team(expert, student, period)
    for (policy, period), team in teams.items():
        report(f"rolling out {policy} at ratio {ratio_title(period)}")
        scores = score_rollouts(roll_out(gait, team, WORLDS["training"], config))
        scores.insert(0, "policy", policy)
        scores.insert(1, "ratio", ratio_title(period))
        tables.append(scores)
    return pd.concat(tables, ignore_index=True)
