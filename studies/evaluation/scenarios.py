"""`glassgait evaluate scenarios`: falls, return and tracking of every policy in every scenario."""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.settings import checked
from glassgait.models.task.command import DEAD_BAND
from glassgait.models.task.termination import PHYSICAL_FALL
from glassgait.studies.common.cases import Case, not_finite_lines, score
from glassgait.studies.common.experiment import Report, RolloutExperiment, ScenarioNames
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.common.scores import PHYSICAL, SPEED_ERROR_TITLE, summarize, summary
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students import policy_title
from glassgait.studies.evaluation.fall_map import (
    fall_map,
    fall_overview,
    policies_of,
    worst_first,
)

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
    "going_speed_error": SPEED_ERROR_TITLE,
    "yaw_rate_error": "yaw-rate error (rad/s)",
    "way": "share of the commanded way",
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
            "share of way": with_interval(means, "way", 2),
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
    """Words falls, and how many of them are physical where that is known and there are any."""
    of = [f"{falls} of {n}" for falls, n in zip(means["falls"], means["robots"], strict=True)]
    if "physical_falls" not in means:
        return of
    physical = zip(of, means["falls"], means["physical_falls"], strict=True)
    return [f"{text} ({count} physical)" if falls else text for text, falls, count in physical]


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


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the policies and columns of `fall_table` as people do."""
    named = table.assign(policy=[policy_title(name) for name in table["policy"]])
    reference = policies_of(table)[0]
    other = "the expert" if reference == EXPERT else policy_title(reference)
    titles = {key: title.replace("the expert", other) for key, title in TITLES.items()}
    return named[[name for name in titles if name in named]].rename(columns=titles)


def worst_table(table: pd.DataFrame) -> pd.DataFrame:
    """Lists where each policy falls most, beside the training world and all worlds together.

    `return` is the mean of all robots in all scenarios.

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
                "return": f"{np.average(own['return'], weights=own['robots']):,.0f}",
            }
        )
    return pd.DataFrame(rows)


def _falls(row: pd.Series) -> str:
    return f"{row['falls']} of {row['robots']}"


def _percents(row: pd.Series) -> str:
    return f"{100 * row['fall_rate_low']:.0f} to {100 * row['fall_rate_high']:.0f} %"


@checked
class Scenarios(RolloutExperiment):
    """Let policies walk alone in every scenario, and report scores and falls.

    One policy gives a scorecard, several a map of falls.
    """

    title: ClassVar[str] = "evaluate scenarios"
    together: ClassVar[bool] = True

    scenario: ScenarioNames = ("all",)

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots of one seed out, and scores them.

        Where any of them falls, they are rolled out once more: the column `fell_physically` holds
        which of them fall where only a physical fall ends an episode.
        """
        own = case.with_config(self.rollouts(case))
        scores = score(own)
        lasting = replace(own, scenario=replace(own.scenario, limits=PHYSICAL_FALL))
        again = scores["fell"].any() and lasting.scenario != own.scenario
        return scores.assign(**{PHYSICAL: score(lasting)["fell"] if again else scores["fell"]})

    def report(self, table: pd.DataFrame) -> Report:
        """Reports the scores of each policy and scenario."""
        lines = [
            *not_finite_lines(table),
            f"drawn speeds below {DEAD_BAND:g} m/s are commands to stand, which the speed error "
            "leaves out",
        ]
        if all(len(own) == 1 for own in self.controllers.values()):
            return self._scorecard(table, lines)
        falls = {
            str(gait): fall_table(own, self.scenario_titles)
            for gait, own in table.groupby("gait", sort=False)
        }
        whole = pd.concat([own.assign(gait=gait) for gait, own in falls.items()])
        readable = pd.concat(
            [_after_gait(gait, readable_table(own), len(falls)) for gait, own in falls.items()]
        )
        return Report(
            tables={"robots": table, "scenarios": readable},
            metrics={"scenarios": json_records(whole)},
            figures=_maps(falls),
            shown={
                f"{gait}: where each falls most": worst_table(own) for gait, own in falls.items()
            },
            lines=lines,
        )

    def _scorecard(self, table: pd.DataFrame, lines: list[str]) -> Report:
        card = scorecard_table(table, self.scenario_titles)
        falls = falls_table(table, self.scenario_titles)
        policies = [
            f"{gait}: {policy_title(name)}"
            for gait, own in self.controllers.items()
            for name in own
        ]
        return Report(
            tables={"robots": table, "scorecard": card, "falls": falls},
            metrics=summarize(table, ["gait", "scenario"]).to_dict(orient="records"),
            shown={", ".join(policies): card},
            lines=lines,
        )


def _after_gait(gait: str, table: pd.DataFrame, n_gaits: int) -> pd.DataFrame:
    if n_gaits > 1:
        table.insert(0, "gait", gait)
    return table


def _maps(falls: Mapping[str, pd.DataFrame]) -> dict[str, Figure]:
    """Draws a map of each gait, and of several all side by side."""
    title = "falls of each policy alone, worst scenario first"
    maps = {gait: fall_map(own, f"{gait.capitalize()}: {title}") for gait, own in falls.items()}
    if len(maps) == 1:
        return {"scenarios": next(iter(maps.values()))}
    named = {f"scenarios_{gait}": figure for gait, figure in maps.items()}
    return named | {"scenarios": fall_overview(falls)}
