"""The figure of the claims: what formulas predict beside what robots do."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots

HOLDS, FAILS, PREDICTED = "#1b6ca8", "#c0392b", "0.35"
"""Colours of claims that hold, of those that do not, and of what was predicted."""

TITLES = {
    "joint": "The term sees one standard deviation more of its input",
    "following": "The term is replaced by its mean",
}
LABELS = {
    "joint": "movement of its joint (rad)",
    "following": "by how much more robots miss their command (m/s or rad/s)",
}
"""What stands above and below the panel of each subject."""

ROW = 0.3
"""Height of a row (inches)."""


@styled
def claims_figure(table: pd.DataFrame, title: str) -> Figure:
    """Draws each claim's predicted effect and the measured one with its 95 % interval, a row each.

    Args:
        table: What `Examiner.examine` returned.
        title: What stands above.
    """
    parts = [part for _, part in table.groupby("subject", sort=False)]
    heights = [len(part) + 1 for part in parts]
    figure, panels = subplots(
        len(parts),
        1,
        figsize=(2 * COLUMN_WIDTH, ROW * sum(heights) + 0.7 * len(parts) + 0.4),
        squeeze=False,
        height_ratios=heights,
    )
    for panel, part in zip(panels[:, 0], parts, strict=True):
        _draw(panel, part)
        panel.set_title(TITLES[part["subject"].iloc[0]])
        panel.set_xlabel(LABELS[part["subject"].iloc[0]])
    figure.legend(handles=_legend(table), loc="outside upper center", ncols=3, title=title)
    return figure


def _draw(panel: Axes, part: pd.DataFrame) -> None:
    panel.axvline(0.0, color="0.6", linewidth=0.8)
    for row, cell in enumerate(part.to_dict(orient="records")):
        color = HOLDS if cell["holds"] else FAILS
        panel.plot(
            cell["predicted"], row, marker="D", color=PREDICTED, markersize=4, fillstyle="none"
        )
        panel.errorbar(
            cell["measured"],
            row,
            xerr=cell["high"] - cell["measured"],
            fmt="o" if cell["holds"] else "X",
            color=color,
            markersize=4,
            elinewidth=1.2,
            capsize=2,
        )
    panel.set_yticks(range(len(part)), [_label(cell) for cell in part.to_dict(orient="records")])
    panel.set_ylim(len(part) - 0.4, -0.6)
    panel.grid(visible=False, axis="y")


def _label(cell: dict) -> str:
    where = f", state {cell['state']}" if cell["state"] >= 0 else ""
    return f"{cell['joint']}{where}: {cell['term']}"


def _legend(table: pd.DataFrame) -> list[Line2D]:
    style = {"linestyle": "none", "markersize": 4}
    handles = [
        Line2D([], [], marker="D", color=PREDICTED, fillstyle="none", label="predicted", **style),
        Line2D([], [], marker="o", color=HOLDS, label="measured: the claim holds", **style),
    ]
    if not table["holds"].all():
        fails = Line2D([], [], marker="X", color=FAILS, label="measured: it does not", **style)
        handles.append(fails)
    return handles
