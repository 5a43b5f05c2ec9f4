"""Tables of evaluations: falls by scenario, students beside their expert, pushes survived."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
from scipy import stats

from glassgait.models.policies.policy import Policy
from glassgait.models.policies.reading_cost import READING_COST_TITLES, reading_cost
from glassgait.studies.common.scores import summarize, wilson_interval
from glassgait.studies.common.tables import HALF

COSTS = {title: title for title in READING_COST_TITLES}

TITLES = {
    "policy": "policy",
    "world": "scenario",
    "ratio": "ratio",
    "robots": "robots",
    "falls": "falls",
    "physical_falls": "physical falls",
    "fall_rate": "share of falls",
    "fall_rate_low": "95 % from",
    "fall_rate_high": "95 % to",
    "points_more": "points more than the expert",
    "share": "share of the expert's return",
    "share_ci": f"share of the expert's return{HALF}",
    "plain_share": "share of the plain return",
    "plain_share_ci": f"share of the plain return{HALF}",
    "going_speed_error": "speed error (m/s)",
    "yaw_rate_error": "yaw-rate error (rad/s)",
    "return": "return",
    "return_ci": f"return{HALF}",
    "plain_return": "plain return",
    "rhythm": "rhythm",
    **COSTS,
}
"""Titles of the columns of `summarize` and `with_reading_cost`, in the order of tables."""

SCORES = ("share", "plain_share", "going_speed_error", "yaw_rate_error")
"""Columns of return and command tracking, which tables always show together."""

STANDALONE = ("policy", "robots", "falls", "share", "share_ci", "plain_share", "plain_share_ci")
STANDALONE += ("going_speed_error", "yaw_rate_error", "return", "return_ci", "rhythm", *COSTS)
"""Columns of the table of students without the expert."""

MAIN = ("policy", "world", "falls", *SCORES, READING_COST_TITLES[0])
"""Columns that fit into a terminal."""


def fall_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Summarizes every policy in every scenario, the worst scenario first.

    Returns one row per policy and scenario, with the columns of `summarize`. Policies of the same
    gait are compared with the expert or, without it, with the first policy.
    """
    table = summarize(scores, ["policy", "scenario"], against=policies_of(scores)[0])
    table.insert(2, "world", table["scenario"].map(titles))
    # Equally bad scenarios keep the order of `titles`.
    table = table.sort_values("scenario", key=lambda x: x.map(list(titles).index), kind="stable")
    policies, scenarios = policies_of(table), worst_first(table)
    table = table.sort_values("policy", key=lambda x: x.map(policies.index), kind="stable")
    table = table.sort_values("scenario", key=lambda x: x.map(scenarios.index), kind="stable")
    return table.reset_index(drop=True)


def titled_table(table: pd.DataFrame, columns: Collection[str] = tuple(TITLES)) -> pd.DataFrame:
    """Selects columns of a table from `summarize`, and renames them to their titles."""
    reference = policies_of(table)[0]
    other = "the expert" if reference == "expert" else reference
    titles = {k: t.replace("the expert", other).replace("s's", "s'") for k, t in TITLES.items()}
    return table[[name for name in columns if name in table]].rename(columns=titles)


def significant_differences(tables: Collection[pd.DataFrame]) -> str:
    """Counts the significant differences in falls from the reference, by Fisher's exact test with
    Holm's correction for the number of cells."""
    p_values = []
    for table in tables:
        counts = np.stack([table["falls"], table["robots"] - table["falls"]], axis=1)
        cells = dict(zip(zip(table["policy"], table["scenario"], strict=True), counts, strict=True))
        reference = policies_of(table)[0]
        for (policy, scenario), count in cells.items():
            if policy != reference:
                pair = [count, cells[reference, scenario]]
                p_values.append(float(np.asarray(stats.fisher_exact(pair))[1]))
    n = len(p_values)
    significant = int(np.cumprod(np.sort(p_values) * np.arange(n, 0, -1) < 0.05).sum())
    return f"{significant} of {n} differences in falls are significant at 5 % (Fisher, Holm)"


def worst_first(table: pd.DataFrame, policies: Collection[str] = ()) -> list[str]:
    """Sorts scenarios by the share of robots that fall, of all or of the named policies.

    The greatest share comes first; scenarios with equal shares keep the table's order.
    """
    scenarios = table["scenario"].unique()
    counted = table[table["policy"].isin(policies)] if policies else table
    sums = counted.groupby("scenario")[["falls", "robots"]].sum().reindex(scenarios)
    shares = sums["falls"] / sums["robots"]
    return shares.sort_values(ascending=False, kind="stable").index.tolist()


def with_reading_cost(table: pd.DataFrame, policies: Mapping[str, Policy]) -> pd.DataFrame:
    """Adds the columns of `reading_cost`, by the column `policy`."""
    costs = {name: reading_cost(policies[name]) for name in table["policy"].unique()}
    columns = zip(*(costs[name] for name in table["policy"]), strict=True)
    return table.assign(**dict(zip(READING_COST_TITLES, columns, strict=True)))


def policies_of(table: pd.DataFrame) -> list[str]:
    """Lists the policies of a table, the expert first and the others in the table's order."""
    return sorted(dict.fromkeys(table["policy"]), key=lambda name: name != "expert")


def alternation_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Averages scores of every policy at every ratio, with shares of the expert's return."""
    return summarize(scores, ["policy", "ratio"], against="expert")


def standalone_table(scores: pd.DataFrame, policies: Mapping[str, Policy]) -> pd.DataFrame:
    """Compares students without the expert with the expert (paper, Table II)."""
    means = alternation_table(scores)
    standalone = means[(means["policy"] == "expert") | (means["ratio"] == 0.0)]
    table = titled_table(with_reading_cost(standalone, policies), STANDALONE)
    return table.reset_index(drop=True)


def push_summary(pushes: pd.DataFrame) -> pd.DataFrame:
    """Summarizes the pushes that each policy survives, and counts the failures after the others."""
    rows = []
    for policy, group in pushes.groupby("policy", sort=False):
        by_speed = group.groupby("speed (m/s)")["survived"].mean()
        row = {"policy": policy, **_survival(group["survived"])}
        for share, title in ((1.0, "all"), (0.5, "half")):
            speeds = by_speed.index[(by_speed >= share).cummin()]
            row[f"{title} survived up to (m/s)"] = max(speeds, default=0.0)
        row["weakest direction (°)"] = group.groupby("direction (°)")["survived"].mean().idxmin()
        rows.append(row)
    ends = pd.crosstab(pushes["policy"], pushes["end"]).drop(columns="", errors="ignore")
    ends = ends.rename(columns=lambda name: name.replace("_", " "))
    return pd.DataFrame(rows).join(ends, on="policy")


def push_table(pushes: pd.DataFrame) -> pd.DataFrame:
    """Counts the robots that survive, with one row per policy, direction and speed."""
    keys = ["policy", "direction (°)", "speed (m/s)"]
    groups = pushes.groupby(keys, sort=False)["survived"]
    rows = [dict(zip(keys, key, strict=True)) | _survival(group) for key, group in groups]
    return pd.DataFrame(rows)


def _survival(survived: pd.Series) -> dict[str, float]:
    low, high = wilson_interval(int(survived.sum()), len(survived))
    counts = {"pushes": len(survived), "survived": int(survived.sum())}
    return {**counts, "share": survived.mean(), "95 % from": low, "95 % to": high}
