"""Tables of falls: a row a policy and world, and the worst world of each policy."""

from collections.abc import Mapping

import pandas as pd
from scipy import stats

from glassgait.diagrams.scenario import TRAINING
from glassgait.studies.common.rollouts.scores import SPEED_ERROR_TITLE, summarize_against
from glassgait.studies.distillation.students.registry import STUDENTS, policy_title

TITLES = {
    "policy": "policy",
    "world": "scenario",
    "robots": "robots",
    "falls": "falls",
    "fall_rate": "share of falls",
    "fall_rate_low": "95 % from",
    "fall_rate_high": "95 % to",
    "points_more": "points more than the expert",
    "share": "share of the expert's return",
    "share_ci": "±",
    "going_speed_error": SPEED_ERROR_TITLE,
    "yaw_rate_error": "yaw-rate error (rad/s)",
    "rhythm": "rhythm",
}
"""What people call the columns of `fall_table`."""


def wilson_interval(falls: int, robots: int) -> tuple[float, float]:
    """Returns the 95 % interval of a share of falls, by Wilson's score."""
    bounds = stats.binomtest(falls, robots).proportion_ci(confidence_level=0.95, method="wilson")
    return float(bounds.low), float(bounds.high)


def fall_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up every policy in every world, the worst world first, the expert before its students.

    Args:
        scores: What `run_jobs` returned of `world_jobs`.
        titles: What people call each scenario.

    Returns:
        A row a policy and world: falls of robots, their share and its 95 % interval, `points_more`
        falls of a hundred than the expert there, the share of the expert's reward with its paired
        interval, and what `summarize` returns.
    """
    parts = []
    for name in titles:
        own = scores[scores["scenario"] == name]
        expert = own[own["policy"] == "expert"]
        part = summarize_against(own, ["policy"], expert)
        part.insert(1, "scenario", name)
        part.insert(2, "world", titles[name])
        part["points_more"] = 100.0 * (part["fall_rate"] - expert["fell"].mean())
        parts.append(part)
    table = pd.concat(parts, ignore_index=True)
    pairs = zip(table["falls"], table["robots"], strict=True)
    bounds = [wilson_interval(falls, robots) for falls, robots in pairs]
    table[["fall_rate_low", "fall_rate_high"]] = bounds
    worlds = pd.Categorical(table["scenario"], worst_first(table))
    policies = pd.Categorical(table["policy"], policies_of(table))
    order = pd.DataFrame({"world": worlds.codes, "policy": policies.codes})
    return table.loc[order.sort_values(["world", "policy"]).index].reset_index(drop=True)


def worst_first(table: pd.DataFrame) -> list[str]:
    """Lists the scenarios by the greatest share of falls of any policy, then by the mean share."""
    rates = table.groupby("scenario", sort=False)["fall_rate"].agg(["max", "mean"])
    return rates.sort_values(["max", "mean"], ascending=False, kind="stable").index.tolist()


def policies_of(table: pd.DataFrame) -> list[str]:
    """Lists the policies of a table, the expert first, then students in the registry's order."""
    there = set(table["policy"])
    return [name for name in ("expert", *STUDENTS) if name in there]


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the policies and columns of `fall_table` as people do."""
    named = table.assign(policy=[policy_title(name) for name in table["policy"]])
    return named[list(TITLES)].rename(columns=TITLES)


def worst_table(table: pd.DataFrame) -> pd.DataFrame:
    """Tells where each policy falls most, beside the training world and all worlds together.

    Its worst world is that with the greatest lower end of the interval of its share of falls: one
    fall of one robot says less than twenty of 26.
    """
    rows = []
    for name in policies_of(table):
        own = table[table["policy"] == name]
        home = own[own["scenario"] == TRAINING]
        worst = own.iloc[own["fall_rate_low"].argmax()]
        fell = worst["falls"] > 0
        rows.append(
            {
                "policy": policy_title(name),
                "its worst scenario": worst["world"] if fell else "–",
                "falls there": _falls(worst) if fell else "–",
                "95 % interval": _percents(worst) if fell else "–",
                "points more than the expert": f"{worst['points_more']:+.0f}" if fell else "–",
                "falls in training scenario": _falls(home.iloc[0]) if len(home) else "–",
                "scenarios without a fall": f"{(own['falls'] == 0).sum()} of {len(own)}",
            }
        )
    return pd.DataFrame(rows)


def _falls(row: pd.Series) -> str:
    return f"{row['falls']} of {row['robots']}"


def _percents(row: pd.Series) -> str:
    return f"{100 * row['fall_rate_low']:.0f} to {100 * row['fall_rate_high']:.0f} %"
