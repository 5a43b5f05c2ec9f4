"""Figures of closed-loop scores: reward against alternation ratio, speed against command."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.palette import COLORS
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.rollouts.alternation import PERIODS
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.evaluation.tables import alternation_table, policy_title
from glassgait.studies.evaluation.tracking import COMMANDED, MEASURED

LEAST_SHARE = 0.9
"""Share of the expert's reward from which students are told apart."""


@styled
def reward_figure(scores: pd.DataFrame, title: str) -> Figure:
    """Average episodic reward and falls against the alternation ratio (paper, Figure 2).

    Between them stands the share of the expert's reward from `LEAST_SHARE` on, whose intervals are
    much shorter: it compares robots under the same commands and noise.
    """
    means = alternation_table(scores)
    expert = means[means["policy"] == "expert"].iloc[0]
    figure, (reward, share, falls) = subplots(
        3, 1, figsize=(COLUMN_WIDTH, 4.6), sharex=True, height_ratios=(5, 4, 3)
    )
    known = set(means["ratio"])
    ratios = [ratio_title(period) for period in PERIODS if ratio_title(period) in known]
    students = [student for student in STUDENTS.values() if student.name in set(means["policy"])]
    for i, student in enumerate(students):
        mine = means[means["policy"] == student.name].set_index("ratio")
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
        reward.errorbar(at, mine["reward"], mine["reward_ci"], **bars)
        in_sight = mine["share"] >= LEAST_SHARE
        share.errorbar(at, mine["share"], mine["share_ci"].where(in_sight), **bars)
        falls.plot(at, 100 * mine["fall_rate"].astype(float), **style)
    reward.axhline(expert["reward"], color="black", linewidth=0.8, linestyle=":")
    share.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    reward.set(ylabel="return", ylim=(0, None))
    # Some copies earn more than the expert.
    most = max(1.01, float((means["share"] + means["share_ci"]).max()) + 0.005)
    share.set(ylabel="share of the\nexpert's return", ylim=(LEAST_SHARE, most))
    share.set_yticks(np.linspace(LEAST_SHARE, 1.0, 3))
    falls.set(xlabel="alternation ratio", ylabel="falls (%)", ylim=(-5, 105))
    falls.set_xticks(np.arange(len(ratios)), ratios)
    handles, labels = reward.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, title=title)
    figure.align_ylabels()
    return figure


@styled
def tracking_figure(table: pd.DataFrame, title: str) -> Figure:
    """Draws measured against commanded speed and yaw rate, a line a policy or gait.

    Speeds are those of robots that do not turn, yaw rates those of robots that go at one speed. A
    robot that does as it is told is on the dotted line.

    Args:
        table: What `tracking_table` returned.
        title: The legend's title.
    """
    figure, panels = subplots(1, 2, figsize=(2 * COLUMN_WIDTH, 3.2))
    who = str(table.columns[0])
    straight = table[COMMANDED[1]] == 0.0
    turning = table[COMMANDED[0]] == table.loc[~straight, COMMANDED[0]].max()
    for axes, commanded, measured, rows in zip(
        panels, COMMANDED, MEASURED, (straight, turning), strict=True
    ):
        shown = table[rows].sort_values(commanded)
        if len(shown):
            ends = [shown[commanded].min(), shown[commanded].max()]
            axes.plot(ends, ends, color="black", linewidth=0.8, linestyle=":")
        for i, name in enumerate(table[who].unique()):
            mine = shown[shown[who] == name]
            axes.errorbar(
                mine[commanded],
                mine[measured],
                mine[f"{measured.split(' (')[0]} ±"],
                label=policy_title(str(name)),
                color=COLORS[i % len(COLORS)],
                marker="osv^Dx"[i % 6],
                markersize=3.5,
                linewidth=1.0,
                capsize=1.5,
            )
        axes.set(xlabel=commanded, ylabel=measured)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, title=title)
    return figure
