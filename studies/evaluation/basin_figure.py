"""The picture of predicted pushes: what was survived, and the borders of the sets."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from glassgait.models.arrays import Array
from glassgait.studies.common.figures import styled
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.push_sets import Prediction

N_PANELS = 4
"""Phases that are drawn, equally far apart; each with the pushes that came nearest to it."""

PANEL = 1.75
"""Width of a panel (inches)."""

LOOKS = {
    "circle": ("0.45", ":"),
    "ellipses of the stride map": ("#0072B2", "--"),
    "fitted conics": ("#D55E00", "-"),
}
"""Colour and dashes of each set's border, by Okabe and Ito."""

SURVIVED, FELL = "#56B4E9", "0.1"


@styled
def basin_figure(found: Mapping[str, Sequence[Prediction]], title: str) -> Figure:
    """Draws a row of each policy: pushes in four phases, and the borders of the sets there.

    Args:
        found: The predictions by policy.
        title: What stands above.
    """
    n = len(found)
    figure = Figure(figsize=(PANEL * N_PANELS + 0.6, PANEL * n + 0.75), layout="constrained")
    rows = figure.subplots(n, N_PANELS, sharex=True, sharey=True, squeeze=False)
    for axes_row, (policy, predictions) in zip(rows, found.items(), strict=True):
        for panel, axes in enumerate(axes_row):
            _draw(axes, predictions, panel / N_PANELS)
        axes_row[0].set_ylabel(f"{policy_title(policy)}\nforward (m/s)")
    for panel, axes in enumerate(rows[0]):
        axes.set_title(f"{panel / N_PANELS:g} of the stride", fontsize=7.5)
    for axes in rows[-1]:
        axes.set_xlabel("to the left (m/s)")
    there = {one.own.title for predictions in found.values() for one in predictions}
    handles = [
        Line2D([], [], color=SURVIVED, marker="o", ms=3, ls="", label="survived"),
        Line2D([], [], color=FELL, marker="x", ms=3, ls="", label="not survived"),
        *(
            Line2D([], [], color=color, ls=dashes, label=name)
            for name, (color, dashes) in LOOKS.items()
            if name in there
        ),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=6.5, frameon=False)
    figure.suptitle(
        f"{title}: pushes that no set has seen, and within which borders survival is predicted",
        fontsize=8,
    )
    return figure


def _draw(axes: Axes, predictions: Sequence[Prediction], phase: float) -> None:
    test = predictions[0].test
    apart = np.abs((test.phase - phase + 0.5) % 1.0 - 0.5)
    near = apart <= 0.5 / N_PANELS
    for alive, color, marker, size in ((True, SURVIVED, "o", 3.0), (False, FELL, "x", 7.0)):
        forward, left = test.velocity[near & (test.survived == alive)].T
        axes.scatter(left, forward, s=size, c=color, marker=marker, linewidths=0.5, zorder=2)
    reach = float(np.linalg.norm(test.velocity, axis=1).max(initial=0.1))
    for one in predictions:
        if np.isfinite(one.threshold):
            color, dashes = LOOKS[one.own.title]
            _draw_border(axes, one, phase, reach, color, dashes)
    # Left is left for a robot that faces upward.
    axes.set_xlim(reach, -reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")


def _draw_border(
    axes: Axes, one: Prediction, phase: float, reach: float, color: str, dashes: str
) -> None:
    line: Array = np.linspace(-reach, reach, 121)
    left, forward = np.meshgrid(line, line)
    velocity = np.stack([forward.ravel(), left.ravel()], axis=1)
    margin = one.own.margin(velocity, np.full(len(velocity), phase)) - one.threshold
    # Nothing is predicted of pushes that are greater than those that were tried.
    margin[np.linalg.norm(velocity, axis=1) > reach] = np.nan
    axes.contour(
        left,
        forward,
        margin.reshape(left.shape),
        levels=[0.0],
        colors=[color],
        linestyles=[dashes],
        linewidths=1.1,
        zorder=3,
    )
