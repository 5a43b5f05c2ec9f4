"""Sums over robots, with intervals: of shares of falls by Wilson, of returns in pairs."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy import stats

from glassgait.studies.common.scores import return_shares, summarize

PLACES = ("gait", "scenario")
"""Columns in which a policy and its reference agree."""


def wilson_interval(count: int, n: int) -> tuple[float, float]:
    """Returns the 95 % interval of a share, by Wilson's score."""
    bounds = stats.binomtest(count, n).proportion_ci(confidence_level=0.95, method="wilson")
    return float(bounds.low), float(bounds.high)


def summary(scores: pd.DataFrame, by: Sequence[str], against: str | None = None) -> pd.DataFrame:
    """Averages scores over robots, with falls and intervals.

    Args:
        scores: Scores, a row a robot.
        by: Columns that distinguish groups.
        against: The policy that others are compared with, robot by robot, where gait and scenario
            are the same; none by default.

    Returns:
        A row a group, in the order of the scores: what `summarize` returns; the 95 % interval of
        the share of falls, `fall_rate_low` and `fall_rate_high`; and, where there is a reference,
        `points_more` falls of a hundred than it, and the `share` of its return with its paired
        interval `share_ci`.
    """
    keys = list(by)
    table = summarize(scores, keys)
    pairs = zip(table["falls"], table["robots"], strict=True)
    table[["fall_rate_low", "fall_rate_high"]] = [wilson_interval(*pair) for pair in pairs]
    if against is None:
        return table
    places = [name for name in PLACES if name in keys]
    groups = scores.groupby(places, sort=False) if places else [((), scores)]
    parts = []
    for _, group in groups:
        reference = group[group["policy"] == against]
        own = return_shares(group, keys, reference)
        parts.append(own.assign(expected=float(reference["fell"].mean())))
    table = table.merge(pd.concat(parts, ignore_index=True), on=keys)
    table["points_more"] = 100.0 * (table["fall_rate"] - table.pop("expected"))
    return table


def share_called(scores: pd.DataFrame) -> float:
    """Returns the share of all steps in which the expert acted; early falls count for less."""
    return float(np.average(scores["expert_share"], weights=scores["steps"]))
