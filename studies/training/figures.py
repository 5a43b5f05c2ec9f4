"""Draws learning curves."""

from collections.abc import Mapping

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots

_SMOOTHED_UPDATES = 10

_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")

_LABELS = {
    "plain_reward": "plain reward\na step",
    "reward": "reward with\nmachine a step",
    "rhythm": "share of the\nrhythm kept",
    "difficulty": "difficulty of the\nmachine",
    "failure_rate": "failures a robot\nand second",
}


@styled
def learning_curves(curves: Mapping[str, pd.DataFrame]) -> Figure:
    """Draws the learning curves of several runs, a line a run.

    Args:
        curves: Curves as training writes them, by the name of their line.
    """
    columns = ("plain_reward", "reward", "rhythm", "difficulty", "failure_rate")
    figure, axes = subplots(
        len(columns), 1, figsize=(1.5 * COLUMN_WIDTH, 1.05 * len(columns) + 0.6), sharex=True
    )
    for panel, column in zip(axes, columns, strict=True):
        for (name, curve), color in zip(curves.items(), _COLORS, strict=False):
            _draw(panel, curve, column, name, color)
        panel.set_ylabel(_LABELS[column])
        panel.set_ylim(bottom=0)
    axes[-1].set_xlabel("control steps (millions)")
    figure.align_ylabels()
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=min(6, len(curves))
    )
    return figure


def _draw(panel: Axes, curve: pd.DataFrame, column: str, name: str, color: str) -> None:
    values = curve[column].rolling(_SMOOTHED_UPDATES, min_periods=1).mean()
    # Failures are counted per control step of 0.02 s.
    scale = 50.0 if column == "failure_rate" else 1.0
    panel.plot(curve["control_steps"] / 1e6, scale * values, label=name, color=color, linewidth=1.0)
