"""Figures of importances, and of what is lost without observations."""

import numpy as np
import pandas as pd
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from models.a1 import robot
from models.a1.robot import Array
from studies.distillation.config import STUDENT_TITLES
from studies.figures import COLUMN_WIDTH
from studies.importance.methods import METHOD_TITLES
from studies.importance.truth import MODE_TITLES

_MODE_COLORS = {"mean": "#0072B2", "shuffled": "#E69F00", "delayed": "#999999"}


def importance_map(importances: Array, names: tuple[str, ...], title: str) -> Figure:
    """Draws importances (12, n) as a map, each joint's scaled to add up to 1 (paper, Figure 11)."""
    positive = np.maximum(importances, 0.0)
    totals = positive.sum(axis=1, keepdims=True)
    shares = np.divide(positive, totals, out=np.zeros_like(positive), where=totals > 0)
    figure, axes = plt.subplots(figsize=(2 * COLUMN_WIDTH, 2.9))
    image = axes.imshow(shares, cmap="viridis", aspect="auto", vmin=0.0)
    axes.set_yticks(range(robot.N_JOINTS), [name.replace("_", " ") for name in robot.JOINTS])
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=5)
    axes.set_title(title)
    axes.grid(visible=False)
    bar = figure.colorbar(image, ax=axes, pad=0.01)
    bar.set_label("share of a joint's importance")
    return figure


def loss_figure(lost: pd.DataFrame, title: str) -> Figure:
    """Draws the share of its reward that each student loses without each group, a panel each."""
    students = list(dict.fromkeys(lost["policy"]))
    groups = list(dict.fromkeys(lost["without"]))
    size = (2 * COLUMN_WIDTH, 0.6 + 0.13 * len(groups) + 0.6)
    figure, panels = plt.subplots(1, len(students), figsize=size, sharey=True, squeeze=False)
    for panel, student in zip(panels[0], students, strict=True):
        for shift, (mode, color) in enumerate(_MODE_COLORS.items()):
            mine = lost.query("policy == @student and mode == @mode").set_index("without")
            mine = mine.loc[groups]
            at = np.arange(len(groups)) + 0.27 * (shift - 1)
            panel.barh(at, mine["lost"], 0.25, color=color, label=MODE_TITLES[mode])
            panel.errorbar(
                mine["lost"], at, xerr=mine["lost_ci"], fmt="none", ecolor="0.3", elinewidth=0.5
            )
        panel.set_title(STUDENT_TITLES.get(student, student))
        panel.set_xlabel("share of reward lost")
        panel.set_yticks(range(len(groups)), groups, fontsize=6)
    panels[0][0].invert_yaxis()
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, title=title)
    return figure


def truth_figure(importances: pd.DataFrame, lost: pd.DataFrame, title: str) -> Figure:
    """Draws what each method foretells against the loss that followed, a panel a method."""
    joined = importances.merge(lost.query("mode == 'shuffled'"), on=["policy", "without"])
    pairs = list(dict.fromkeys(zip(joined["policy"], joined["method"], strict=True)))
    columns = min(3, len(pairs))
    rows = -(-len(pairs) // columns)
    figure, panels = plt.subplots(
        rows, columns, figsize=(2 * COLUMN_WIDTH, 1.7 * rows + 0.3), squeeze=False
    )
    for panel in panels.flat[len(pairs) :]:
        panel.set_visible(False)
    for panel, (policy, method) in zip(panels.flat, pairs, strict=False):
        own = joined.query("policy == @policy and method == @method")
        shares = own["importance"] / own["importance"].sum()
        panel.scatter(shares, own["lost"], s=10, color="#0072B2")
        for x, y, name in zip(shares, own["lost"], own["without"], strict=True):
            panel.annotate(name, (x, y), fontsize=4, xytext=(2, 1), textcoords="offset points")
        panel.set_title(f"{STUDENT_TITLES.get(policy, policy)}: {METHOD_TITLES[method]}")
        panel.set_xlabel("share of importance")
        panel.set_ylabel("share of reward lost")
    figure.suptitle(title, fontsize=8)
    return figure
