"""The figure of the front: reward and falls against size."""

from math import ceil, log2

import pandas as pd
from matplotlib.figure import Figure

from glassgait.studies.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.pareto.formulas import FAMILIES

_STYLES = {
    "linear": {"color": "#999999", "marker": "v"},
    "gated": {"color": "#009E73", "marker": "D"},
    "statewise_linear": {"color": "#56B4E9", "marker": "^"},
    "statewise_gated": {"color": "#CC79A7", "marker": "P"},
}


@styled
def pareto_figure(front: pd.DataFrame, title: str) -> Figure:
    """Draws share of the expert's reward, falls and R² against the nodes of a joint's formula."""
    figure, axes = subplots(3, 1, figsize=(COLUMN_WIDTH, 4.6), sharex=True)
    for family, style in _STYLES.items():
        mine = front[front["family"] == family].sort_values("nodes")
        line = {"label": FAMILIES[family].title, "markersize": 3.5, "linewidth": 1.0, **style}
        axes[0].plot(mine["nodes"], mine["share"], **line)
        axes[1].plot(mine["nodes"], 100 * mine["fall_rate"], **line)
        axes[2].plot(mine["nodes"], mine["r2"], **line)
    axes[0].axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    axes[0].set(ylabel="share of the\nexpert's reward", ylim=(0, None))
    axes[1].set(ylabel="falls (%)", ylim=(-5, 105))
    axes[2].set(ylabel="R²", ylim=(0, 1), xlabel="nodes of a joint's formula", xscale="log")
    ticks = [2**power for power in range(1, 1 + ceil(log2(front["nodes"].max())))]
    axes[2].set_xticks(ticks, [str(tick) for tick in ticks])
    axes[2].minorticks_off()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=2, title=title)
    figure.align_ylabels()
    return figure
