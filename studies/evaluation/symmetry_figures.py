"""The figure of the symmetry: what left legs are worth to a policy, against right ones."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from glassgait.models.robots import quadruped
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.distillation.students.registry import STUDENTS, student_title

MARKERS = dict(zip(quadruped.LEG_JOINTS, ("o", "^", "s"), strict=True))

LEAST = 1e-4
"""Importances below it are drawn on the edge."""

EXPERT_COLOR = "black"


@styled
def symmetry_figure(table: pd.DataFrame, left_right: pd.DataFrame, title: str) -> Figure:
    """Draws left importance against right, a panel a policy; alike on both sides, on the diagonal.

    Pairs that both are 0 are left out.

    Args:
        table: A row a policy, as `measure_symmetry` returns it.
        left_right: What `left_right_table` returned for every policy.
        title: Title of the figure.
    """
    columns = min(3, len(table))
    rows = -(-len(table) // columns)
    figure, panels = subplots(
        rows,
        columns,
        figsize=(max(columns, 2) * 0.68 * COLUMN_WIDTH, 2.2 * rows + 0.5),
        squeeze=False,
        sharex=True,
        sharey=True,
    )
    greatest = float(np.nanmax(left_right[["left", "right"]].to_numpy(), initial=1.0))
    for panel in panels.flat[len(table) :]:
        panel.set_visible(False)
    for panel, row in zip(panels.flat, table.itertuples(index=False), strict=False):
        name = str(row.policy)
        _draw_pairs(panel, left_right[left_right["policy"] == name], _color(name))
        panel.set_title(f"{student_title(name)}, R² = {row.r2:.2f}")
        panel.set(xscale="log", yscale="log")
        panel.set(xlim=(0.7 * LEAST, 2 * greatest), ylim=(0.7 * LEAST, 2 * greatest))
        panel.set_aspect("equal")
    for panel in panels[:, 0]:
        panel.set_ylabel("importance of right legs")
    for panel in panels.flat[max(0, len(table) - columns) : len(table)]:
        panel.set_xlabel("importance of left legs")
        panel.tick_params(labelbottom=True)
    figure.legend(handles=_legend(), loc="outside upper center", ncols=4, title=title)
    return figure


def _color(policy: str) -> str:
    return STUDENTS[policy].color if policy in STUDENTS else EXPERT_COLOR


def _draw_pairs(panel: Axes, pairs: pd.DataFrame, color: str) -> None:
    edges = (0.1 * LEAST, 1e3)
    panel.plot(edges, edges, color="0.7", linewidth=0.8)
    pairs = pairs[pairs["left"] + pairs["right"] > 0]
    for joint, marker in MARKERS.items():
        for agree in (True, False):
            own = pairs[(pairs["joint"] == joint) & (pairs["agree"] == agree)]
            left, right = (np.maximum(own[side], LEAST) for side in ("left", "right"))
            panel.errorbar(
                left,
                right,
                xerr=np.minimum(own["left_ci"], 0.99 * left),
                yerr=np.minimum(own["right_ci"], 0.99 * right),
                fmt=marker,
                color=color,
                markersize=3.5,
                markerfacecolor=color if agree else "white",
                markeredgewidth=0.8,
                elinewidth=0.4,
            )


def _legend() -> list[Line2D]:
    style = {"color": "0.3", "linestyle": "none", "markersize": 3.5}
    handles = [
        Line2D([], [], marker=marker, label=joint, **style) for joint, marker in MARKERS.items()
    ]
    hollow = {**style, "markerfacecolor": "white"}
    return [*handles, Line2D([], [], marker="D", label="hollow: intervals apart", **hollow)]
