"""Figures of learning curves."""

from collections.abc import Mapping

import pandas as pd
from matplotlib.figure import Figure

from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots

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
    """Draws learning curves from training, by the labels of their lines."""
    size = (1.5 * COLUMN_WIDTH, 1.05 * len(_LABELS) + 0.6)
    figure, axes = subplots(len(_LABELS), 1, figsize=size, sharex=True)
    for panel, (column, label) in zip(axes, _LABELS.items(), strict=True):
        # Smooth over ten updates, and convert failures per control step of 0.02 s to per second.
        scale = 50.0 if column == "failure_rate" else 1.0
        for (name, curve), color in zip(curves.items(), _COLORS, strict=False):
            values = scale * curve[column].rolling(10, min_periods=1).mean()
            panel.plot(curve["control_steps"] / 1e6, values, label=name, color=color, linewidth=1.0)
        panel.set_ylabel(label)
        panel.set_ylim(bottom=0)

    # All panels share the axis of steps and the legend.
    axes[-1].set_xlabel("control steps (millions)")
    figure.align_ylabels()
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=min(6, len(curves))
    )
    return figure
