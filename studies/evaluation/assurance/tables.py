"""The table of assurance: a row a policy and world."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from glassgait.studies.common.scores import summarize_against
from glassgait.studies.common.summary import wilson_interval
from glassgait.studies.distillation.students.registry import policy_title

TITLES = {
    "world": "scenario",
    "policy": "policy",
    "called": "steps of the expert",
    "robots": "robots",
    "falls": "falls",
    "fall_rate_low": "95 % from",
    "fall_rate_high": "95 % to",
    "points_more": "points more than the expert",
    "share": "share of the expert's return",
    "share_ci": "±",
}
"""What people call the columns of `assurance_table`."""


def acting_title(name: str) -> str:
    """Returns what people call a policy of the study."""
    kind, _, calls = name.partition("_")
    match kind:
        case "assured":
            return f"Assured, {100 * float(calls):g} % in training"
        case "schedule":
            return f"Schedule, as many as assured, {100 * float(calls):g} %"
        case _:
            return policy_title(name)


def assurance_table(scores: pd.DataFrame, titles: Mapping[str, str]) -> pd.DataFrame:
    """Sums up every policy in every world.

    Args:
        scores: What `roll_out_all` returned.
        titles: What people call each scenario.

    Returns:
        A row a policy and world: `called`, the share of steps that the expert acted in, falls with
        their 95 % interval by Wilson's score, `points_more` falls of a hundred than the expert
        there, the share of the expert's reward with its paired interval, and what `summarize`
        returns.
    """
    parts = []
    for name, title in titles.items():
        own = scores[scores["scenario"] == name]
        expert = own[own["policy"] == "expert"]
        part = summarize_against(own, ["policy"], expert)
        called = {
            policy: np.average(rows["expert_share"], weights=rows["steps"])
            for policy, rows in own.groupby("policy")
        }
        part.insert(1, "scenario", name)
        part.insert(2, "world", title)
        part["called"] = [float(called[policy]) for policy in part["policy"]]
        part["points_more"] = 100.0 * (part["fall_rate"] - expert["fell"].mean())
        parts.append(part)
    table = pd.concat(parts, ignore_index=True)
    pairs = zip(table["falls"], table["robots"], strict=True)
    table[["fall_rate_low", "fall_rate_high"]] = [wilson_interval(*pair) for pair in pairs]
    return table


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the policies and columns of `assurance_table` as people do."""
    named = table.assign(policy=[acting_title(name) for name in table["policy"]])
    return named[list(TITLES)].rename(columns=TITLES)
