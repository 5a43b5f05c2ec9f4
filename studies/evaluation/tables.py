"""Tables of closed-loop scores."""

from collections.abc import Mapping

import pandas as pd

from glassgait.studies.common.rollouts.scores import SPEED_ERROR_TITLE, summarize, summarize_against
from glassgait.studies.distillation.students.registry import policy_title


def alternation_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Means of every policy at every ratio, and the share of the expert's reward."""
    expert = scores[scores["policy"] == "expert"]
    return summarize_against(scores, ["policy", "ratio"], expert)


def standalone_table(scores: pd.DataFrame) -> pd.DataFrame:
    """The students alone beside the expert alone: the table that matters."""
    means = alternation_table(scores)
    alone = means[(means["policy"] == "expert") | (means["ratio"] == "0")]
    return pd.DataFrame(
        {
            "policy": [policy_title(name) for name in alone["policy"]],
            "return": _with_interval(alone, "reward", 0),
            "share of expert": _with_interval(alone, "share", 3),
            "plain return": _with_interval(alone, "plain_reward", 1),
            "falls": _falls(alone),
            "rhythm": alone["rhythm"].round(3),
            SPEED_ERROR_TITLE: alone["going_speed_error"].round(3),
            "yaw-rate error (rad/s)": alone["yaw_rate_error"].round(3),
        }
    )


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
            "falls": _falls(means),
            SPEED_ERROR_TITLE: _with_interval(means, "going_speed_error", 3),
            "yaw-rate error (rad/s)": _with_interval(means, "yaw_rate_error", 3),
            "rhythm": _with_interval(means, "rhythm", 3),
            "plain return": _with_interval(means, "plain_reward", 1),
            "return": _with_interval(means, "reward", 0),
            "cost of transport": _with_interval(means, "cost_of_transport", 2),
        }
    )


def falls_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Falls of robots, a row a scenario and a column a gait."""
    means = summarize(scores, ["gait", "scenario"])
    means["falls"] = _falls(means)
    table = means.pivot_table(
        "falls", index="scenario", columns="gait", aggfunc="first", sort=False
    ).fillna("–")
    table = table.loc[[name for name in titles if name in table.index]]
    table.index = pd.Index([titles[name] for name in table.index], name="scenario")
    return table.rename_axis(columns=None).reset_index()


def _falls(means: pd.DataFrame) -> list[str]:
    return [f"{falls} of {n}" for falls, n in zip(means["falls"], means["robots"], strict=True)]


def _with_interval(means: pd.DataFrame, name: str, digits: int) -> list[str]:
    pairs = zip(means[name], means[f"{name}_ci"], strict=True)
    # A single robot has a mean but no interval, and one that never went has neither.
    texts = ((f"{mean:,.{digits}f}", f"{half:,.{digits}f}") for mean, half in pairs)
    return [f"{mean} ± {half}".removesuffix(" ± nan").replace("nan", "–") for mean, half in texts]
