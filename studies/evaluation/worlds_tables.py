"""Tables of falls: a row a policy and world, and the worst world of each policy."""

from collections.abc import Mapping

import pandas as pd

from glassgait.diagrams.scenario import TRAINING
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.scores import SPEED_ERROR_TITLE, summarize
from glassgait.studies.common.summary import summary
from glassgait.studies.distillation.students.registry import policy_title

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
    "return": "return",
    "return_ci": "return ±",
    "going_speed_error": SPEED_ERROR_TITLE,
    "yaw_rate_error": "yaw-rate error (rad/s)",
    "rhythm": "rhythm",
}
"""What people call the columns of `fall_table`."""


def scorecard_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Every gait in every scenario, in the order of the scenarios' titles."""
    means = summarize(scores, ["gait", "scenario"])
    gaits = pd.Categorical(means["gait"], means["gait"].unique())
    scenarios = pd.Categorical(means["scenario"], list(titles))
    means = means.assign(gait=gaits, scenario=scenarios).sort_values(["gait", "scenario"])
    return pd.DataFrame(
        {
            "gait": means["gait"].astype(str),
            "scenario": [titles[name] for name in means["scenario"]],
            "falls": falls_of(means),
            SPEED_ERROR_TITLE: with_interval(means, "going_speed_error", 3),
            "yaw-rate error (rad/s)": with_interval(means, "yaw_rate_error", 3),
            "rhythm": with_interval(means, "rhythm", 3),
            "plain return": with_interval(means, "plain_return", 1),
            "return": with_interval(means, "return", 0),
            "cost of transport": with_interval(means, "cost_of_transport", 2),
        }
    )


def falls_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Falls of robots, a row a scenario and a column a gait."""
    means = summarize(scores, ["gait", "scenario"])
    means["falls"] = falls_of(means)
    table = means.pivot_table(
        "falls", index="scenario", columns="gait", aggfunc="first", sort=False
    ).fillna("–")
    table = table.loc[[name for name in titles if name in table.index]]
    table.index = pd.Index([titles[name] for name in table.index], name="scenario")
    return table.rename_axis(columns=None).reset_index()


def falls_of(means: pd.DataFrame) -> list[str]:
    return [f"{falls} of {n}" for falls, n in zip(means["falls"], means["robots"], strict=True)]


def with_interval(means: pd.DataFrame, name: str, digits: int) -> list[str]:
    pairs = zip(means[name], means[f"{name}_ci"], strict=True)
    # A single robot has a mean but no interval, and one that never went has neither.
    texts = ((f"{mean:,.{digits}f}", f"{half:,.{digits}f}") for mean, half in pairs)
    return [f"{mean} ± {half}".removesuffix(" ± nan").replace("nan", "–") for mean, half in texts]


def fall_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up every policy in every scenario, the worst scenario first.

    Args:
        scores: Scores of one gait; others are compared with the expert or, where
            it is not there, with the first policy.
        titles: What people call each scenario.

    Returns:
        A row a policy and scenario: what `summary` returns.
    """
    table = summary(scores, ["policy", "scenario"], against=policies_of(scores)[0])
    table.insert(2, "world", table["scenario"].map(titles))
    there = {name: place for place, name in enumerate(titles)}
    table = table.sort_values("scenario", key=lambda own: own.map(there), kind="stable")
    worlds = pd.Categorical(table["scenario"], worst_first(table))
    policies = pd.Categorical(table["policy"], policies_of(table))
    order = pd.DataFrame({"world": worlds.codes, "policy": policies.codes}, index=table.index)
    return table.loc[order.sort_values(["world", "policy"]).index].reset_index(drop=True)


def worst_first(table: pd.DataFrame) -> list[str]:
    """Lists the scenarios by the greatest share of falls of any policy, then by the mean share."""
    rates = table.groupby("scenario", sort=False)["fall_rate"].agg(["max", "mean"])
    return rates.sort_values(["max", "mean"], ascending=False, kind="stable").index.tolist()


def policies_of(table: pd.DataFrame) -> list[str]:
    """Lists the policies of a table as they come, but for the expert, which is the first."""
    there = list(dict.fromkeys(table["policy"]))
    return sorted(there, key=lambda name: name != EXPERT)


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the policies and columns of `fall_table` as people do."""
    named = table.assign(policy=[policy_title(name) for name in table["policy"]])
    reference = policies_of(table)[0]
    other = "the expert" if reference == EXPERT else policy_title(reference)
    titles = {key: title.replace("the expert", other) for key, title in TITLES.items()}
    return named[list(titles)].rename(columns=titles)


def worst_table(table: pd.DataFrame) -> pd.DataFrame:
    """Lists where each policy falls most, beside the training world and all worlds together.

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
