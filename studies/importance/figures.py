"""Figures of importances, and of what is lost without observations."""

import textwrap

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.importance.faithfulness import MODE_TITLES, AblationMode
from glassgait.studies.importance.methods import METHOD_TITLES

_MODE_COLORS: dict[AblationMode, str] = {
    "mean": "#0072B2",
    "shuffled": "#E69F00",
    "delayed": "#999999",
}


@styled
def importance_map(importances: Array, names: tuple[str, ...], title: str) -> Figure:
    """Draws importances (12, n) as a map, each joint's scaled to add up to 1 (paper, Figure 11)."""
    positive = np.maximum(importances, 0.0)
    totals = positive.sum(axis=1, keepdims=True)
    shares = np.divide(positive, totals, out=np.zeros_like(positive), where=totals > 0)
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 2.9))
    image = axes.imshow(shares, cmap="viridis", aspect="auto", vmin=0.0)
    axes.set_yticks(
        range(quadruped.N_JOINTS), [name.replace("_", " ") for name in quadruped.JOINTS]
    )
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=5)
    axes.set_title(title)
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, pad=0.01)
    bar.set_label("share of a joint's importance")
    return figure


@styled
def loss_figure(lost: pd.DataFrame, title: str) -> Figure:
    """Draws the share of its return that each student loses without each group, a panel each."""
    students = list(dict.fromkeys(lost["policy"]))
    groups = list(dict.fromkeys(lost["without"]))
    size = (2 * COLUMN_WIDTH, 0.6 + 0.13 * len(groups) + 0.6)
    figure, panels = subplots(1, len(students), figsize=size, sharey=True, squeeze=False)
    for panel, student in zip(panels[0], students, strict=True):
        for shift, (mode, color) in enumerate(_MODE_COLORS.items()):
            mine = lost.query("policy == @student and mode == @mode").set_index("without")
            mine = mine.loc[groups]
            at = np.arange(len(groups)) + 0.27 * (shift - 1)
            panel.barh(at, mine["lost"], 0.25, color=color, label=MODE_TITLES[mode])
            panel.errorbar(
                mine["lost"], at, xerr=mine["lost_ci"], fmt="none", ecolor="0.3", elinewidth=0.5
            )
        panel.set_title(textwrap.fill(student_title(student), 14))
        panel.set_xlabel("share of return lost")
        panel.set_yticks(range(len(groups)), groups, fontsize=6)
    panels[0][0].invert_yaxis()
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, title=title)
    return figure


@styled
def faithfulness_figure(importances: pd.DataFrame, lost: pd.DataFrame, title: str) -> Figure:
    """Draws which observations each method ranks high against the loss that followed.

    Of a method that can be believed all points lie on the diagonal.
    """
    joined = importances.merge(lost.query("mode == 'shuffled'"), on=["policy", "without"])
    pairs = list(dict.fromkeys(zip(joined["policy"], joined["method"], strict=True)))
    rows = -(-len(pairs) // 2)
    figure, panels = subplots(
        rows, 2, figsize=(2 * COLUMN_WIDTH, 2.2 * rows + 0.3), squeeze=False, sharex=True
    )
    for panel in panels.flat[len(pairs) :]:
        panel.set_visible(False)
    for panel, (policy, method) in zip(panels.flat, pairs, strict=False):
        own = joined.query("policy == @policy and method == @method")
        _draw_ranks(panel, own)
        name = f"{student_title(policy)}: {METHOD_TITLES[method]}"
        correlation = own["importance"].corr(own["lost"], method="spearman")
        panel.set_title(f"{name}, ρ = {correlation:.2f}")
    for panel in panels[:, 0]:
        panel.set_ylabel("rank by return lost")
    for panel in panels.flat[max(0, len(pairs) - 2) : len(pairs)]:
        panel.set_xlabel("rank by importance (most to the right)")
        panel.tick_params(labelbottom=True)
    figure.suptitle(title, fontsize=8)
    return figure


def _draw_ranks(panel: Axes, own: pd.DataFrame) -> None:
    count = len(own)
    panel.plot([1, count], [1, count], color="0.7", linewidth=0.8)
    for x, y, name in zip(
        own["importance"].rank(), own["lost"].rank(), own["without"], strict=True
    ):
        panel.scatter(x, y, s=10, color="#0072B2")
        left = x > count / 2
        panel.annotate(
            name,
            (x, y),
            fontsize=5,
            xytext=(-3 if left else 3, 0),
            textcoords="offset points",
            ha="right" if left else "left",
            va="center",
        )
    panel.set(xlim=(0, count + 1), ylim=(0, count + 1))
    panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    panel.yaxis.set_major_locator(MaxNLocator(integer=True))
