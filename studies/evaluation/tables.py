"""Tables of evaluations: falls by scenario, students beside their expert, pushes survived."""

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import TRAINING
from glassgait.studies.common.scores import SPEED_ERROR_TITLE, summarize, wilson_interval
from glassgait.studies.distillation.students import policy_title
from glassgait.studies.evaluation.pushing import Basin

TITLES = {
    "policy": "policy",
    "world": "scenario",
    "robots": "robots",
    "falls": "falls",
    "physical_falls": "physical falls",
    "fall_rate": "share of falls",
    "fall_rate_low": "95 % from",
    "fall_rate_high": "95 % to",
    "points_more": "points more than the expert",
    "share": "share of the expert's return",
    "share_ci": "±",
    "return": "return",
    "return_ci": "return ±",
    "plain_return": "plain return",
    "going_speed_error": SPEED_ERROR_TITLE,
    "yaw_rate_error": "yaw-rate error (rad/s)",
    "way": "share of the commanded way",
    "rhythm": "rhythm",
    "cost_of_transport": "cost of transport",
}
"""Titles of the columns of `fall_table`."""


def fall_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up every policy in every scenario, the worst scenario first.

    Args:
        scores: Scores of one gait; policies are compared with the expert or, where it is not there,
            with the first policy.
        titles: The scenarios' titles by their names.

    Returns:
        A row a policy and scenario: the columns of `summarize`.
    """
    table = summarize(scores, ["policy", "scenario"], against=policies_of(scores)[0])
    table.insert(2, "world", table["scenario"].map(titles))
    there = {name: place for place, name in enumerate(titles)}
    table = table.sort_values("scenario", key=lambda own: own.map(there), kind="stable")
    scenarios = pd.Categorical(table["scenario"], worst_first(table))
    policies = pd.Categorical(table["policy"], policies_of(table))
    order = pd.DataFrame({"scenario": scenarios.codes, "policy": policies.codes}, table.index)
    return table.loc[order.sort_values(["scenario", "policy"]).index].reset_index(drop=True)


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Gives policies and columns of `fall_table` their titles."""
    named = table.assign(policy=[policy_title(name) for name in table["policy"]])
    reference = policies_of(table)[0]
    other = "the expert" if reference == "expert" else policy_title(reference)
    titles = {key: title.replace("the expert", other) for key, title in TITLES.items()}
    return named[[name for name in titles if name in named]].rename(columns=titles)


def worst_table(table: pd.DataFrame) -> pd.DataFrame:
    """Lists where each policy falls most, beside the training scenario and all scenarios together.

    `return` is the mean of all robots in all scenarios. The worst scenario is the one with the
    greatest lower end of the interval of its share of falls: one fall of one robot says less than
    twenty of 26.
    """
    rows = []
    for name in policies_of(table):
        own = table[table["policy"] == name]
        home = own[own["scenario"] == TRAINING]
        worst = own.iloc[own["fall_rate_low"].argmax()]
        fell = worst["falls"] > 0
        interval = f"{100 * worst['fall_rate_low']:.0f} to {100 * worst['fall_rate_high']:.0f} %"
        rows.append(
            {
                "policy": policy_title(name),
                "its worst scenario": worst["world"] if fell else "–",
                "falls there": f"{worst['falls']} of {worst['robots']}" if fell else "–",
                "95 % interval": interval if fell else "–",
                "points more than the expert": f"{worst['points_more']:+.0f}" if fell else "–",
                "falls in training scenario": falls_of(home)[0] if len(home) else "–",
                "scenarios without a fall": f"{(own['falls'] == 0).sum()} of {len(own)}",
                "return": f"{np.average(own['return'], weights=own['robots']):,.0f}",
            }
        )
    return pd.DataFrame(rows)


def worst_first(table: pd.DataFrame, policies: Collection[str] = ()) -> list[str]:
    """Lists the scenarios by the share of robots that fall, the greatest first.

    Args:
        table: Falls, a row a policy and scenario.
        policies: Policies whose robots are counted; by default all.

    Returns:
        All scenarios of the table; those of one share stay in its order.
    """
    scenarios = table["scenario"].unique()
    counted = table[table["policy"].isin(policies)] if policies else table
    sums = counted.groupby("scenario")[["falls", "robots"]].sum().reindex(scenarios)
    shares = sums["falls"] / sums["robots"]
    return shares.sort_values(ascending=False, kind="stable").index.tolist()


def policies_of(table: pd.DataFrame) -> list[str]:
    """Lists the policies of a table in its order, but the expert first."""
    return sorted(dict.fromkeys(table["policy"]), key=lambda name: name != "expert")


def falls_of(means: pd.DataFrame) -> list[str]:
    """Words falls, such as `2 of 26`."""
    return [f"{falls} of {n}" for falls, n in zip(means["falls"], means["robots"], strict=True)]


def with_interval(means: pd.DataFrame, name: str, digits: int) -> list[str]:
    """Words means with the half widths of their intervals, where there are any."""
    pairs = zip(means[name], means[f"{name}_ci"], strict=True)
    texts = ((f"{mean:,.{digits}f}", f"{half:,.{digits}f}") for mean, half in pairs)
    return [f"{mean} ± {half}".removesuffix(" ± nan").replace("nan", "–") for mean, half in texts]


def alternation_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Averages scores of every policy at every ratio, with shares of the expert's return."""
    return summarize(scores, ["policy", "ratio"], against="expert")


def standalone_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Sets the students without the expert beside the expert (paper, Table II)."""
    means = alternation_table(scores)
    alone = means[(means["policy"] == "expert") | (means["ratio"] == "0")]
    return pd.DataFrame(
        {
            "policy": [policy_title(name) for name in alone["policy"]],
            "return": with_interval(alone, "return", 0),
            "share of expert": with_interval(alone, "share", 3),
            "plain return": with_interval(alone, "plain_return", 1),
            "falls": falls_of(alone),
            "rhythm": alone["rhythm"].round(3),
            SPEED_ERROR_TITLE: alone["going_speed_error"].round(3),
            "yaw-rate error (rad/s)": alone["yaw_rate_error"].round(3),
        }
    )


def push_summary(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Sums up the pushes that each policy survives, a row a policy."""
    rows = []
    for policy, basin in basins.items():
        n_pushes = int(np.prod(basin.grid.shape))
        survived = int(basin.survived.sum())
        low, high = wilson_interval(survived, n_pushes)
        means = basin.shares.mean(axis=1)
        weakest = basin.grid.directions[means == means.min()]
        ends = sorted(basin.failures.items(), key=lambda end: -end[1])
        named = [f"{name.replace('_', ' ')} {count}" for name, count in ends if count]
        rows.append(
            {
                "policy": policy_title(policy),
                "all survived up to (m/s)": basin.all_up_to,
                "half survived up to (m/s)": basin.half_up_to,
                "survived": f"{survived} of {n_pushes}",
                "share": survived / n_pushes,
                "95 % from": low,
                "95 % to": high,
                "weakest direction": ", ".join(f"{np.degrees(own):.0f}°" for own in weakest),
                "how the others ended": ", ".join(named) or "–",
            }
        )
    return pd.DataFrame(rows)


def push_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Counts the robots that survive, a row a policy, direction and speed."""
    rows = []
    for policy, basin in basins.items():
        for (i, j), survived in np.ndenumerate(basin.survived):
            low, high = wilson_interval(int(survived), basin.grid.n_phases)
            rows.append(
                {
                    "policy": policy_title(policy),
                    "direction (°)": round(float(np.degrees(basin.grid.directions[i])), 6),
                    "speed (m/s)": float(basin.grid.speeds[j]),
                    "robots": basin.grid.n_phases,
                    "survived": int(survived),
                    "share": survived / basin.grid.n_phases,
                    "95 % from": low,
                    "95 % to": high,
                }
            )
    return pd.DataFrame(rows)
