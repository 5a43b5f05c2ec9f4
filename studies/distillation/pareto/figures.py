"""The figure of the front: return and falls against the number of terms."""

import pandas as pd
from matplotlib.figure import Figure

from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.distillation.pareto.formulas import FAMILIES

_STYLES = {
    "mirrored": {"color": "#0072B2", "marker": "o"},
    "unmirrored": {"color": "#999999", "marker": "v"},
    "refined": {"color": "#D55E00", "marker": "*"},
}


@styled
def pareto_figure(front: pd.DataFrame, title: str) -> Figure:
    """Draws share of the expert's return, falls and R² against the terms of all formulas."""
    figure, axes = subplots(3, 1, figsize=(COLUMN_WIDTH, 4.6), sharex=True)
    for family, own in front.groupby("family"):
        mine = own.sort_values("terms")
        style = _STYLES[str(family)]
        label = FAMILIES[str(family)].title
        line = {"label": label, "markersize": 3.5, "linewidth": 1.0, **style}
        axes[0].plot(mine["terms"], mine["share"], **line)
        axes[1].plot(mine["terms"], 100 * mine["fall_rate"], **line)
        axes[2].plot(mine["terms"], mine["r2"], **line)
    axes[0].axhline(1.0, color="black", linewidth=0.8, linestyle=":")
    axes[0].set(ylabel="share of the\nexpert's return", ylim=(0, None))
    axes[1].set(ylabel="falls (%)", ylim=(-5, 105))
    axes[2].set(ylabel="R²", ylim=(None, 1), xlabel="terms of all formulas", xscale="log")
    ticks = sorted({*front["terms"]})
    axes[2].set_xticks(ticks, [str(tick) for tick in ticks])
    axes[2].minorticks_off()
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, title=title)
    figure.align_ylabels()
    return figure
