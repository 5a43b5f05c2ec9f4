"""Tables of evaluations: falls by scenario, students beside their expert, pushes survived."""

from collections.abc import Callable, Collection, Mapping

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import NOMINAL_SCENARIO
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.reading_cost import READING_COST_TITLES, reading_cost
from glassgait.studies.common.scores import summarize, wilson_interval
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
    "going_speed_error": "speed error, commanded to go (m/s)",
    "yaw_rate_error": "yaw-rate error (rad/s)",
    "way": "share of the commanded way",
    "rhythm": "rhythm",
    "cost_of_transport": "cost of transport",
    **{title: title for title in READING_COST_TITLES},
}
"""Titles of the columns of `fall_table` and `with_reading_cost`."""


def fall_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up every policy in every scenario, the worst scenario first.

    A row a policy and scenario, with the columns of `summarize`. Policies of the one gait are
    compared with the expert or, without it, with the first policy.
    """
    table = summarize(scores, ["policy", "scenario"], against=policies_of(scores)[0])
    table.insert(2, "world", table["scenario"].map(titles))
    # Equally bad scenarios stay in the order in which they were named.
    table = table.sort_values("scenario", key=_places(list(titles)), kind="stable")
    policies, scenarios = policies_of(table), worst_first(table)
    table = table.sort_values("policy", key=_places(policies), kind="stable")
    table = table.sort_values("scenario", key=_places(scenarios), kind="stable")
    return table.reset_index(drop=True)


def _places(names: list[str]) -> Callable[[pd.Series], pd.Series]:
    """Returns a key that sorts names by their places in a list."""
    return lambda column: column.map(names.index)


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Gives policies and columns of `fall_table` their titles."""
    named = table
    reference = policies_of(table)[0]
    other = "the expert" if reference == "expert" else reference
    titles = {key: title.replace("the expert", other) for key, title in TITLES.items()}
    return named[[name for name in titles if name in named]].rename(columns=titles)


def worst_table(table: pd.DataFrame) -> pd.DataFrame:
    """Lists where each policy falls most, beside the nominal scenario and all scenarios together.

    `return` is the mean of all robots in all scenarios. The worst scenario is the one with the
    greatest lower end of the interval of its share of falls: one fall of one robot says less than
    twenty of 26.
    """
    rows = []
    for name in policies_of(table):
        everywhere = table[table["policy"] == name]
        training = everywhere[everywhere["scenario"] == NOMINAL_SCENARIO]
        worst = everywhere.iloc[everywhere["fall_rate_low"].argmax()]
        interval = f"{100 * worst['fall_rate_low']:.0f} to {100 * worst['fall_rate_high']:.0f} %"
        there = {
            "its worst scenario": worst["world"],
            "falls there": f"{worst['falls']} of {worst['robots']}",
            "95 % interval": interval,
            "points more than the expert": f"{worst['points_more']:+.0f}",
        }
        rows.append(
            {"policy": name}
            | (there if worst["falls"] > 0 else dict.fromkeys(there, "–"))
            | {
                "falls in nominal scenario": falls_of(training)[0] if len(training) else "–",
                "scenarios without a fall": f"{sum(everywhere['falls'] == 0)} of {len(everywhere)}",
                "return": f"{np.average(everywhere['return'], weights=everywhere['robots']):,.0f}",
            }
            | {title: everywhere[title].iloc[0] for title in READING_COST_TITLES if title in table}
        )
    return pd.DataFrame(rows)


def worst_first(table: pd.DataFrame, policies: Collection[str] = ()) -> list[str]:
    """Lists all scenarios by the share of robots that fall, of all or of the named policies.

    The greatest comes first; scenarios of one share stay in the table's order.
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
    """Lists the policies of a table in its order, but the expert first."""
    return sorted(dict.fromkeys(table["policy"]), key=lambda name: name != "expert")


def falls_of(means: pd.DataFrame) -> list[str]:
    """Formats falls, such as `2 of 26`."""
    return [f"{falls} of {n}" for falls, n in zip(means["falls"], means["robots"], strict=True)]


def with_interval(means: pd.DataFrame, name: str, digits: int) -> list[str]:
    """Formats means with the half widths of their intervals, where there are any."""
    pairs = zip(means[name], means[f"{name}_ci"], strict=True)
    texts = ((f"{mean:,.{digits}f}", f"{half:,.{digits}f}") for mean, half in pairs)
    return [f"{mean} ± {half}".removesuffix(" ± nan").replace("nan", "–") for mean, half in texts]


def alternation_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Averages scores of every policy at every ratio, with shares of the expert's return."""
    return summarize(scores, ["policy", "ratio"], against="expert")


def standalone_table(scores: pd.DataFrame, policies: Mapping[str, Policy]) -> pd.DataFrame:
    """Sets the students without the expert beside the expert (paper, Table II)."""
    means = alternation_table(scores)
    alone = means[(means["policy"] == "expert") | (means["ratio"] == "0")]
    table = pd.DataFrame(
        {
            "policy": alone["policy"].tolist(),
            "return": with_interval(alone, "return", 0),
            "share of expert": with_interval(alone, "share", 3),
            "plain return": with_interval(alone, "plain_return", 1),
            "falls": falls_of(alone),
            "rhythm": alone["rhythm"].round(3),
            TITLES["going_speed_error"]: alone["going_speed_error"].round(3),
            TITLES["yaw_rate_error"]: alone["yaw_rate_error"].round(3),
        }
    )
    return with_reading_cost(table, policies)


def push_summary(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Sums up the pushes that each policy survives, a row a policy."""
    rows = []
    for policy, basin in basins.items():
        n_pushes, survived = int(np.prod(basin.grid.shape)), int(basin.survived.sum())
        means = basin.shares.mean(axis=1)
        weakest = basin.grid.directions[means == means.min()]
        ends = sorted(basin.failures.items(), key=lambda end: -end[1])
        named = [f"{name.replace('_', ' ')} {count}" for name, count in ends if count]
        rows.append(
            {
                "policy": policy,
                "all survived up to (m/s)": basin.survived_up_to(1.0),
                "half survived up to (m/s)": basin.survived_up_to(0.5),
                "survived": f"{survived} of {n_pushes}",
                **_share(survived, n_pushes),
                "weakest direction": ", ".join(f"{np.degrees(angle):.0f}°" for angle in weakest),
                "how the others ended": ", ".join(named) or "–",
            }
        )
    return pd.DataFrame(rows)


def push_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Counts the robots that survive, a row a policy, direction and speed."""
    rows = [
        {
            "policy": policy,
            "direction (°)": round(float(np.degrees(basin.grid.directions[i])), 6),
            "speed (m/s)": float(basin.grid.speeds[j]),
            "robots": basin.grid.n_phases,
            "survived": int(survived),
            **_share(int(survived), basin.grid.n_phases),
        }
        for policy, basin in basins.items()
        for (i, j), survived in np.ndenumerate(basin.survived)
    ]
    return pd.DataFrame(rows)


def _share(survived: int, n_pushes: int) -> dict[str, float]:
    low, high = wilson_interval(survived, n_pushes)
    return {"share": survived / n_pushes, "95 % from": low, "95 % to": high}
