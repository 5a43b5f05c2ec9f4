"""The figure of two policies' targets: joint by joint, instant by instant."""

import numpy as np
from matplotlib.figure import Figure

from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.evaluation.compare.targets import TargetDifference

COLORS = "RdBu_r"
"""Of two hues that colour-blind readers tell apart, white where both ask for the same."""


@styled
def difference_figure(difference: TargetDifference, title: str) -> Figure:
    """Draws the targets of B less those of A, a row a joint, over time.

    Args:
        difference: The differences; grey where they are not finite.
        title: What stands above.
    """
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 2.6))
    greatest = float(np.nanmax(np.abs(difference.values), initial=0.0)) or 1.0
    time = difference.time
    edges = (time[0], time[-1] + CONTROL_PERIOD, quadruped.N_JOINTS - 0.5, -0.5)
    picture = axes.imshow(
        difference.values.T,
        aspect="auto",
        cmap=COLORS,
        vmin=-greatest,
        vmax=greatest,
        extent=edges,
        interpolation="nearest",
    )
    axes.set_facecolor("0.6")
    axes.grid(visible=False)
    axes.set_yticks(
        range(quadruped.N_JOINTS), [name.replace("_", " ") for name in quadruped.JOINTS]
    )
    for leg in range(1, quadruped.N_LEGS):
        axes.axhline(len(quadruped.LEG_JOINTS) * leg - 0.5, color="0.3", linewidth=0.5)
    axes.set(xlabel="time (s)", title=title)
    figure.colorbar(picture, ax=axes).set_label("target of B less that of A (rad)")
    return figure
