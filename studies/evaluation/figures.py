"""Figures of evaluations: the map of falls, return by alternation ratio, pushes survived."""

import textwrap
from collections.abc import Mapping
from itertools import product
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import PercentFormatter

from glassgait.diagrams.scenario import NOMINAL_SCENARIO
from glassgait.models.arrays import Array
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.drawing import ink_on
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.distillation.students import STUDENTS
from glassgait.studies.evaluation.tables import (
    alternation_table,
    policies_of,
    push_summary,
    worst_first,
)

LEAST_SHARE = 0.9  # lower end of the axis of shares if a student never has less; otherwise 0

# One hue each, from light to dark, which is readable without colour vision.
FALLS, SURVIVAL = mpl.colormaps["Reds"], mpl.colormaps["YlGnBu"]

COLUMN, ROW = 0.24, 0.19  # size of a cell of the map of falls (inches)
RATIO = 0.14  # width of an alternation ratio in the figure of returns (inches)
PANEL = 1.95  # width of a policy's disc of pushes (inches)
MOST_COLUMNS = 5  # greatest number of discs side by side
SIDES = ("ahead", "left", "back", "right")


@styled
def return_figure(scores: pd.DataFrame, title: str) -> Figure:
    """Draws return, share of the expert's return and falls against the alternation ratio, with one
    column per student (paper, Figure 2)."""
    means = alternation_table(scores)
    expert = means[means["policy"] == "expert"].iloc[0]
    ratios = sorted(means["ratio"].unique(), reverse=True)
    at = np.arange(len(ratios))
    students = {kind: STUDENTS[kind] for kind in STUDENTS if kind in set(means["policy"])}
    size = max(COLUMN_WIDTH, 0.6 + RATIO * len(ratios) * len(students)), 4.2
    worst = means[means["policy"] != "expert"].groupby("policy")["share"].min()
    least = LEAST_SHARE if (worst >= LEAST_SHARE).any() else 0.0
    options = {"figsize": size, "sharex": True, "sharey": "row", "squeeze": False}
    figure, panels = subplots(3, len(students), height_ratios=(5, 4, 3), **options)
    for (returns, share, falls), (kind, student) in zip(panels.T, students.items(), strict=True):
        # At ratio 1 every student is the expert.
        line = means[means["policy"] == kind].set_index("ratio")
        line.loc[1.0] = expert
        line = line.loc[ratios]
        style = {"color": student.color, "marker": student.marker}
        style |= {"markersize": 3.5, "linewidth": 1.0}
        returns.errorbar(at, line["return"], line["return_ci"], capsize=1.5, **style)
        in_sight = line["share"] >= least
        share.errorbar(at, line["share"], line["share_ci"].where(in_sight), capsize=1.5, **style)
        falls.plot(at, 100 * line["fall_rate"].astype(float), **style)
        returns.axhline(expert["return"], color="black", linewidth=0.8, linestyle=":")
        share.axhline(1.0, color="black", linewidth=0.8, linestyle=":")
        returns.set_title(kind, fontsize=7)
        titles = [ratio_title(round(1 / ratio) if ratio else 0) for ratio in ratios]
        falls.set_xticks(at, titles, rotation=90)

    # Scale and label the rows. Some students have a greater return than the expert.
    returns, share, falls = panels[:, 0]
    returns.set(ylabel="return", ylim=(0, None))
    most = max(1.01, float((means["share"] + means["share_ci"]).max()) + 0.005)
    share.set(ylabel="share of the\nexpert's return", ylim=(least, most))
    share.set_yticks(np.linspace(least, 1.0, 3))
    falls.set(ylabel="falls (%)", ylim=(-5, 105))
    caption = "alternation ratio; dotted: the expert; bars: 95 % intervals"
    figure.supxlabel(textwrap.fill(caption, round(17 * size[0])), fontsize=7)
    figure.suptitle(title, fontsize=8)
    figure.align_ylabels()
    return figure


@styled
def fall_map(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Draws how many robots fall, by gait and policy (columns) and scenario (rows, worst first).

    `tables` are results of `fall_table` by gait. The order of scenarios depends only on policies
    that all gaits have. Cells that were not measured are hatched.
    """
    whole = pd.concat(list(tables.values()))
    common = set.intersection(*(set(table["policy"]) for table in tables.values()))
    scenarios = worst_first(whole, common)
    counts = [len(policies_of(table)) for table in tables.values()]
    width = max(COLUMN_WIDTH, 2.0 + COLUMN * (sum(counts) + len(counts)))
    size = width, 1.8 + ROW * len(scenarios)
    figure, panels = subplots(
        1, len(tables), figsize=size, squeeze=False, sharey=True, width_ratios=counts
    )

    # Draw the cells of each gait, and frame the nominal scenario.
    for axes, (gait, table) in zip(panels[0], tables.items(), strict=True):
        policies = policies_of(table)
        cells = {(cell["scenario"], cell["policy"]): cell for cell in table.to_dict("records")}
        for (row, scenario), (x, policy) in product(enumerate(scenarios), enumerate(policies)):
            _draw_cell(axes, x, row, cells.get((scenario, policy)))
        if NOMINAL_SCENARIO in scenarios:
            corner = (-0.5, scenarios.index(NOMINAL_SCENARIO) - 0.5)
            frame = Rectangle(corner, len(policies), 1, fill=False, edgecolor="black", linewidth=1)
            axes.add_patch(frame)
        axes.set(xlim=(-0.55, len(policies) - 0.45), ylim=(len(scenarios) - 0.45, -0.55))
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        axes.tick_params(length=0)
        axes.xaxis.tick_top()
        axes.set_xticks(range(len(policies)), policies, fontsize=6.5, rotation=90)
        axes.set_title(gait.replace("_", "-"), fontsize=8)

    # Label the rows, with the number of robots if it is smaller than in other rows.
    most, rows = int(whole["robots"].max()), whole.drop_duplicates("scenario").set_index("scenario")
    names = [
        world + ("" if n == most else f" ({n} robots)")
        for world, n in zip(rows["world"][scenarios], rows["robots"][scenarios], strict=True)
    ]
    axes = panels[0, 0]
    axes.set_yticks(range(len(scenarios)), [textwrap.fill(name, 40) for name in names])
    caption = f"Robots that fall, of {most}. Framed: nominal; hatched: not measured."
    figure.supxlabel(textwrap.fill(caption, round(17 * width)), fontsize=7)
    return figure


def _draw_cell(axes: Axes, x: float, row: int, cell: dict[Any, Any] | None) -> None:
    """Draws a cell: the number of robots that fell, on a colour for their share."""
    if cell is None:
        look = {"facecolor": "0.88", "edgecolor": "0.55", "hatch": "//////", "linewidth": 0.0}
    else:
        color = FALLS(cell["fall_rate"])[:3] if cell["falls"] else (1.0, 1.0, 1.0)
        look = {"facecolor": color, "edgecolor": "0.85", "linewidth": 0.5}
        text, ink = (str(cell["falls"]), ink_on(to_hex(color))) if cell["falls"] else ("·", "0.4")
        axes.text(x, row, text, color=ink, fontsize=7, ha="center", va="center")
    axes.add_patch(Rectangle((x - 0.5, row - 0.5), 1, 1, **look))


@styled
def push_figure(pushes: pd.DataFrame, title: str) -> Figure:
    """Draws one disc per policy: direction as angle, speed as radius, colour for survival."""
    policies = pushes["policy"].unique()
    columns = min(len(policies), MOST_COLUMNS)
    rows = -(-len(policies) // columns)
    size = PANEL * columns + 0.7, (PANEL + 0.2) * rows + 0.4
    polar = {"squeeze": False, "subplot_kw": {"projection": "polar"}}
    figure, grid = subplots(rows, columns, figsize=size, **polar)
    panels = grid.ravel()
    for axes in panels[len(policies) :]:
        axes.set_visible(False)
    limits = push_summary(pushes)["all survived up to (m/s)"]
    for axes, policy, limit in zip(panels, policies, limits, strict=False):
        # Sectors and rings are centred on the pushes that were measured.
        group = pushes[pushes["policy"] == policy]
        shares = group.pivot_table("survived", "speed (m/s)", "direction (°)", aggfunc="mean")
        half = np.pi / shares.shape[1]
        sectors = np.append(np.radians(shares.columns) - half, 2.0 * np.pi - half)
        rings = _rings(shares.index.to_numpy())
        axes.pcolormesh(sectors, rings, shares.astype(float), cmap=SURVIVAL, vmin=0, vmax=1)
        axes.set(theta_zero_location="N", yticks=[])
        axes.set_xticks(np.arange(4) * np.pi / 2, SIDES, fontsize=6.5)
        axes.tick_params(pad=-2)
        axes.set_title(f"{policy}\nall survived up to {limit:.2g} m/s", fontsize=7.5)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), SURVIVAL),
        ax=panels.tolist(),
        format=PercentFormatter(1.0),
        shrink=0.7,
    )
    bar.set_label("share of phases survived")
    figure.suptitle(textwrap.fill(title, round(18 * size[0])), fontsize=8)
    return figure


def _rings(speeds: Array) -> Array:
    """Returns the borders of the rings that are centred on the speeds."""
    if len(speeds) == 1:
        return speeds[0] * np.array([0.5, 1.5])
    middles = 0.5 * (speeds[:-1] + speeds[1:])
    inner, outer = 2.0 * speeds[0] - middles[0], 2.0 * speeds[-1] - middles[-1]
    return np.concatenate([[max(inner, 0.0)], middles, [outer]])
