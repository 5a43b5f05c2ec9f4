"""The figure of the convergence study."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.reproduction.convergence.variants import CENIC, SAP, SAP_DEFAULT

_STYLES = {
    SAP: {"color": "#0072B2", "marker": "o"},
    SAP_DEFAULT: {"color": "#56B4E9", "marker": "s", "linestyle": "--"},
    "similar": {"color": "#009E73", "marker": "^"},
    "lagged": {"color": "#D55E00", "marker": "v"},
    CENIC: {"color": "black", "marker": "x"},
}

_LINE = {"markersize": 4, "linewidth": 1.0}

_LABELS = {
    "stance": "stance after\na drop (m)",
    "height": "trunk after\na drop (m)",
    "survived": "survived of a\nrollout (s)",
    "going_speed_error": "speed error,\ncommanded to go (m/s)",
    "yaw_rate_error": "yaw-rate error\n(rad/s)",
}


@styled
def convergence_figure(results: pd.DataFrame) -> Figure:
    """Draws each measure against the time step, and against CENIC's accuracy beside it.

    Args:
        results: Columns `family`, `resolution` and the measures.
    """
    size = (2 * COLUMN_WIDTH, 1.2 * len(_LABELS) + 0.6)
    figure, axes = subplots(
        len(_LABELS), 2, figsize=size, width_ratios=(3, 1.2), sharex="col", sharey="row"
    )
    for (measure, label), (left, right) in zip(_LABELS.items(), axes, strict=True):
        for family, style in _STYLES.items():
            mine = results[results["family"] == family].sort_values("resolution")
            if family == CENIC:
                right.plot(mine["resolution"], mine[measure], label=family, **_LINE, **style)
            else:
                left.plot(1000 * mine["resolution"], mine[measure], label=family, **_LINE, **style)
        left.set_ylabel(label)
    _label_resolutions(*axes[-1])
    figure.align_ylabels()
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=len(labels))
    return figure


def _label_resolutions(step: Axes, accuracy: Axes) -> None:
    ticks = [0.5, 1, 2, 5, 10, 20]
    step.set(xlabel="time step (ms)", xscale="log")
    step.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    step.minorticks_off()
    accuracy.set(xlabel="accuracy of CENIC", xscale="log")
