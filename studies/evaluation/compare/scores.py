"""The scores of two policies in every world, set in proportion robot by robot."""

from collections.abc import Mapping, Sequence

import pandas as pd

from glassgait.studies.common.rollouts.scores import SPEED_ERROR_TITLE, summarize_against
from glassgait.studies.evaluation.compare.sides import Side

TITLES = {
    "policy": "policy",
    "world": "scenario",
    "robots": "robots",
    "falls": "falls",
    "reward": "return",
    "reward_ci": "return ±",
    "share": "share of A's return",
    "share_ci": "share ±",
    "rhythm": "rhythm",
    "going_speed_error": SPEED_ERROR_TITLE,
    "yaw_rate_error": "yaw-rate error (rad/s)",
}
"""What people call the columns of `score_table`."""


def score_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up both policies in every world.

    Args:
        scores: What `run_jobs` returned of the policies A and B.
        titles: What people call each scenario.

    Returns:
        A row a world and policy, A first: what `summarize` returns, and the `share` of A's return
        in the same world with half the width of its paired 95 % interval, `share_ci`.
    """
    parts = []
    for name, title in titles.items():
        own = scores[scores["scenario"] == name]
        part = summarize_against(own, ["policy"], own[own["policy"] == "A"])
        part.insert(1, "scenario", name)
        part.insert(2, "world", title)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def readable_scores(table: pd.DataFrame, sides: Sequence[Side]) -> pd.DataFrame:
    """Names the policies and columns of `score_table` as people do."""
    called = {side.letter: side.title for side in sides}
    return table.assign(policy=table["policy"].map(called))[list(TITLES)].rename(columns=TITLES)
