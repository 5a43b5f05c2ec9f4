"""Figures of what formulas reach against how long they are."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import PercentFormatter

from glassgait.models.arrays import Array
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.distillation.formula_families import FAMILIES

_STYLES: dict[str, dict[str, Any]] = {
    "mirrored": {"color": "#0072B2", "marker": "o"},
    "unmirrored": {"color": "#999999", "marker": "v"},
    "refined": {"color": "#D55E00", "marker": "*"},
}


NEAREST_LABELS = 1.3
"""Of numbers of terms that differ by a smaller factor only the greater one is labelled."""


@dataclass(frozen=True)
class _Measure:
    """What a row of panels shows.

    Attributes:
        label: Of the vertical axis.
        ends: Columns with the ends of its interval, or the one with half its width.
        bottom: Where the axis begins; None leaves it to the values.
        top: Where it ends.
        mark: Where a dotted line is drawn.
        percent: Whether ticks are percentages.
    """

    label: str
    ends: tuple[str, ...] = ()
    bottom: float | None = None
    top: float | None = None
    mark: float | None = None
    percent: bool = False

    def errors(self, front: pd.DataFrame, column: str) -> Array | None:
        """Returns how far the interval reaches below and above (2, n), if there is one."""
        if not self.ends:
            return None
        least, most = front[self.ends[0]], front[self.ends[-1]]
        if len(self.ends) == 1:
            return np.array([least, most])
        return np.array([front[column] - least, most - front[column]]).clip(0.0)


_MEASURES = {
    "share": _Measure("share of the\nexpert's return", ("share_ci",), bottom=-0.05, mark=1.0),
    "fall_rate": _Measure("falls", ("fall_rate_low", "fall_rate_high"), -0.05, 1.05, percent=True),
    "r2": _Measure("R²", top=1.0),
    "radius": _Measure("spectral radius", ("radius", "greatest_radius"), bottom=0.0, mark=1.0),
}


@styled
def pareto_figure(fronts: Mapping[str, pd.DataFrame]) -> Figure:
    """Draws what formulas reach against the terms of all of them, a column of panels a gait.

    Args:
        fronts: Rows of `pareto_table`, by title; with the columns `radius` and `greatest_radius`,
            where stability was measured, a row of panels more.
    """
    every = pd.concat(fronts.values())
    measures = {column: own for column, own in _MEASURES.items() if column in every}
    width = COLUMN_WIDTH if len(fronts) == 1 else 1.9 * len(fronts)
    size = (width, 0.4 + 1.4 * len(measures))
    figure, axes = subplots(
        len(measures), len(fronts), figsize=size, sharex=True, sharey="row", squeeze=False
    )
    for column, (title, front) in zip(axes.T, fronts.items(), strict=True):
        column[0].set_title(title)
        column[-1].set(xlabel="terms of all formulas")
        for panel, (name, measure) in zip(column, measures.items(), strict=True):
            _draw_measure(panel, front.reindex(columns=every.columns), name, measure)
    for panel, measure in zip(axes[:, 0], measures.values(), strict=True):
        panel.set(ylabel=measure.label)
        # Panels of a row share their axis, which grows with each until now.
        panel.set_ylim(measure.bottom, measure.top)
    _label_terms(axes[0, 0], sorted({*every["terms"]}))
    drawn = {*every["family"]}
    marks = [
        Line2D([], [], label=family.title, **_STYLES[name])
        for name, family in FAMILIES.items()
        if name in drawn
    ]
    figure.legend(handles=marks, loc="outside upper center", ncols=len(marks))
    figure.align_ylabels()
    return figure


def _draw_measure(panel: Axes, front: pd.DataFrame, name: str, measure: _Measure) -> None:
    for family, own in front.groupby("family"):
        mine = own.sort_values("terms").dropna(subset=[name])
        style = {**_STYLES[str(family)], "markersize": 3.5, "linewidth": 1.0}
        errors = measure.errors(mine, name)
        panel.errorbar(mine["terms"], mine[name], errors, capsize=1.5, **style)
    if measure.mark is not None:
        panel.axhline(measure.mark, color="black", linewidth=0.8, linestyle=":")
    if measure.percent:
        panel.yaxis.set_major_formatter(PercentFormatter(1.0))


def _label_terms(panel: Axes, ticks: Sequence[int]) -> None:
    """Makes the axis of terms logarithmic, and labels ticks that are not too near to the next."""
    following = [*ticks[1:], math.inf]
    apart = [after / tick > NEAREST_LABELS for tick, after in zip(ticks, following, strict=True)]
    labels = [str(tick) if far else "" for tick, far in zip(ticks, apart, strict=True)]
    panel.set(xscale="log")
    panel.set_xticks(ticks, labels)
    panel.minorticks_off()
