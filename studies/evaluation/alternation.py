"""`glassgait evaluate alternation`: return against the share of steps at which the expert acts."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
import pandas as pd
from annotated_types import MinLen
from matplotlib.figure import Figure

from glassgait.models.settings import DISTINCT, FEW, checked
from glassgait.models.task.alternation import parse_ratio, ratio_title
from glassgait.studies.common.cases import PERIODS, Case, not_finite_lines, score
from glassgait.studies.common.experiment import Report, RolloutExperiment
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.policies import ALL, EXPERT
from glassgait.studies.common.scores import SPEED_ERROR_TITLE, summarize_against
from glassgait.studies.distillation.students import STUDENTS, policy_title
from glassgait.studies.evaluation.scenarios import falls_of, with_interval

RATIOS = tuple(map(ratio_title, PERIODS))
"""The alternation ratios."""

LEAST_SHARE = 0.9
"""Share of the expert's return above which students differ visibly."""


@checked
class Alternation(RolloutExperiment):
    """Let expert and student act by turns, and report the return at every ratio.

    Attributes:
        ratios: Shares of steps at which the expert acts: 1, 1/2, …, and 0 for students alone.
    """

    title: ClassVar[str] = "evaluate alternation"
    one: ClassVar[tuple[str, ...]] = ("scenario",)

    axes: ClassVar[Mapping[str, str]] = {"ratio": "ratios"}

    ratios: Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT] = RATIOS

    def __post_init__(self) -> None:
        """Adds the expert, whose return is the measure.

        Raises:
            InputError: if a ratio is none.
        """
        periods = list(map(parse_ratio, self.ratios))
        if 1 not in periods:
            object.__setattr__(self, "ratios", (ratio_title(1), *self.ratios))
        if not {EXPERT, ALL} & {*self.policy}:
            object.__setattr__(self, "policy", (EXPERT, *self.policy))

    def measure(self, case: Case) -> pd.DataFrame:
        """Rolls robots of one seed out, and scores them; at ratio 1 the expert acts alone."""
        own, period = case.alone, parse_ratio(case.labels["ratio"])
        if (own.student is None) != (period == 1):
            return pd.DataFrame()
        acting = replace(own, period=period)
        return score(replace(case, controller=acting, config=self.rollouts(case)))

    def report(self, table: pd.DataFrame) -> Report:
        """Reports return and falls by ratio, and of the students alone."""
        return alternation_report(table, self.gaits[0].name)


def alternation_report(scores: pd.DataFrame, title: str) -> Report:
    """Reports the scores of every student at every ratio.

    Args:
        scores: Scores of `alternation_cases`.
        title: What the figure is called.
    """
    ratios, alone = alternation_table(scores), standalone_table(scores)
    return Report(
        tables={"robots": scores, "ratios": ratios, "standalone": alone},
        metrics=ratios.to_dict(orient="records"),
        figures={"return": return_figure(scores, title)},
        shown={f"{title}: students alone": alone},
        lines=not_finite_lines(scores),
    )


def alternation_table(scores: pd.DataFrame) -> pd.DataFrame:
    """Means of every policy at every ratio, and the share of the expert's return."""
    expert = scores[scores["policy"] == "expert"]
    return summarize_against(scores, ["policy", "ratio"], expert)


def standalone_table(scores: pd.DataFrame) -> pd.DataFrame:
    """The students alone beside the expert alone: the table that matters."""
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


@styled
def return_figure(scores: pd.DataFrame, title: str) -> Figure:
    """Average return and falls against the alternation ratio (paper, Figure 2).

    Between them stands the share of the expert's return from `LEAST_SHARE` on, whose intervals are
    much shorter: it compares robots under the same commands and noise.
    """
    means = alternation_table(scores)
    expert = means[means["policy"] == "expert"].iloc[0]
    figure, (returns, share, falls) = subplots(
        3, 1, figsize=(COLUMN_WIDTH, 4.6), sharex=True, height_ratios=(5, 4, 3)
    )
    periods = sorted(map(parse_ratio, means["ratio"].unique()), key=lambda own: (own == 0, own))
    ratios = list(map(ratio_title, periods))
    students = {kind: STUDENTS[kind] for kind in STUDENTS if kind in set(means["policy"])}
    for i, (kind, student) in enumerate(students.items()):
        mine = means[means["policy"] == kind].set_index("ratio")
        mine.loc["1"] = expert
        mine = mine.loc[ratios]
        at = np.arange(len(ratios)) + 0.08 * (i - (len(students) - 1) / 2)
        style = {
            "color": student.color,
            "marker": student.marker,
            "markersize": 3.5,
            "linewidth": 1.0,
        }
        bars = {"label": student.title, "capsize": 1.5, **style}
        returns.errorbar(at, mine["return"], mine["return_ci"], **bars)
        in_sight = mine["share"] >= LEAST_SHARE
        share.errorbar(at, mine["share"], mine["share_ci"].where(in_sight), **bars)
        falls.plot(at, 100 * mine["fall_rate"].astype(float), **style)
    returns.axhline(expert["return"], color="black", linewidth=0.8, linestyle=":")
    share.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    returns.set(ylabel="return", ylim=(0, None))
    # Some copies earn more than the expert.
    most = max(1.01, float((means["share"] + means["share_ci"]).max()) + 0.005)
    share.set(ylabel="share of the\nexpert's return", ylim=(LEAST_SHARE, most))
    share.set_yticks(np.linspace(LEAST_SHARE, 1.0, 3))
    falls.set(xlabel="alternation ratio", ylabel="falls (%)", ylim=(-5, 105))
    falls.set_xticks(np.arange(len(ratios)), ratios)
    handles, labels = returns.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, title=title)
    figure.align_ylabels()
    return figure
