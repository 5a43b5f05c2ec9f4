"""The matrix of transitions: from which gait to which robots fall."""

import textwrap
from itertools import product

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import PercentFormatter

from glassgait.studies.common.figures import styled, subplots
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.evaluation.worlds_figures import COLORS, readable_on

CELL = 0.42
"""Size of a cell (inches)."""


@styled
def transition_figure(table: pd.DataFrame, titles: dict[str, str]) -> Figure:
    """Draws a matrix of each speed, a row of them a policy and world, darker where more fall.

    On the diagonal stand robots that never changed.

    Args:
        table: What `transition_table` returned.
        titles: What people call each scenario.
    """
    lines = table[["policy", "scenario"]].drop_duplicates().to_numpy().tolist()
    speeds, gaits = table["speed"].unique(), table["from"].unique().tolist()
    width, height = CELL * len(gaits) + 0.35, CELL * len(gaits) + 0.45
    size = (1.9 + width * len(speeds), 0.9 + height * len(lines))
    figure, panels = subplots(
        len(lines), len(speeds), figsize=size, squeeze=False, sharex=True, sharey=True
    )
    for (i, (policy, world)), (j, speed) in product(enumerate(lines), enumerate(speeds)):
        chosen = (table["policy"] == policy) & (table["scenario"] == world)
        cells = table[chosen & (table["speed"] == speed)]
        axes = panels[i, j]
        _draw_matrix(axes, cells, gaits)
        if i == 0:
            axes.set_title(f"{speed:g} m/s", fontsize=8)
        if j == 0:
            title = f"{policy_title(policy)}, {titles[world]}"
            axes.set_ylabel(f"{textwrap.fill(title, 24)}\n\nfrom", fontsize=7)
        if i == len(lines) - 1:
            axes.set_xlabel("to")
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), COLORS), ax=panels, format=PercentFormatter(1.0), shrink=0.8
    )
    bar.set_label("share of robots that fall")
    most = int(table["robots"].max())
    caption = (
        f"Falls of {most} robots each, ·\N{NO-BREAK SPACE}is none; framed: robots that never "
        "change their gait."
    )
    figure.supxlabel(textwrap.fill(caption, round(17 * size[0])), fontsize=7)
    return figure


def _draw_matrix(axes: Axes, cells: pd.DataFrame, gaits: list[str]) -> None:
    for cell in cells.to_dict("records"):
        x, y = gaits.index(cell["to"]), gaits.index(cell["from"])
        falls = int(cell["falls"])
        color = COLORS(falls / cell["robots"])[:3] if falls else (1.0, 1.0, 1.0)
        look = {"facecolor": color, "edgecolor": "0.85", "linewidth": 0.5}
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, **look))
        text, ink = (str(falls), readable_on(color)) if falls else ("·", "0.4")
        axes.text(x, y, text, color=ink, fontsize=7, ha="center", va="center")
    for i in range(len(gaits)):
        axes.add_patch(
            Rectangle((i - 0.5, i - 0.5), 1, 1, fill=False, edgecolor="black", linewidth=0.9)
        )
    axes.set(xlim=(-0.55, len(gaits) - 0.45), ylim=(len(gaits) - 0.45, -0.55), aspect="equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    names = [name.replace("_", "-") for name in gaits]
    axes.set_xticks(range(len(gaits)), names, fontsize=6.5, rotation=45, ha="right")
    axes.set_yticks(range(len(gaits)), names, fontsize=6.5)
