"""The map of falls: by policy and world."""

import textwrap
from collections.abc import Collection, Mapping
from itertools import product
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import PercentFormatter

from glassgait.diagrams.scenario import TRAINING
from glassgait.models.task.drawing import ink_on
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.distillation.students import policy_title

COLORS = mpl.colormaps["Reds"].copy()
"""Of one hue, darker for more falls: it is read without seeing colours."""

GAP = 0.25
"""Between the expert and its students (widths of a column)."""

COLUMN, ROW = 0.55, 0.19
"""Size of a cell (inches)."""

NARROW_COLUMN = 0.24
"""The same, of a column where the maps of several gaits stand side by side."""

LEAST_ROWS = 7
"""Rows that a figure has room for at least: its colour bar needs them."""


@styled
def fall_map(table: pd.DataFrame, title: str) -> Figure:
    """Draws the share of robots that fall, a row a world and a column a policy, worst world first.

    Args:
        table: What `fall_table` returned; a policy that it lacks in a world was not rolled out.
        title: What stands above.
    """
    worlds, policies = worst_first(table), policies_of(table)
    at = [column + GAP * (policy != "expert") for column, policy in enumerate(policies)]
    size = (max(COLUMN_WIDTH, 3.1 + COLUMN * at[-1]), 1.5 + ROW * max(len(worlds), LEAST_ROWS))
    figure, axes = subplots(figsize=size)
    rows = table.to_dict(orient="records")
    cells = {(cell["scenario"], cell["policy"]): cell for cell in rows}
    for row, world in enumerate(worlds):
        for x, policy in zip(at, policies, strict=True):
            _draw_cell(axes, x, row, cells.get((world, policy)))
    if TRAINING in worlds:
        _frame(axes, worlds.index(TRAINING), at[-1])
    _name_rows_and_columns(axes, table, worlds, policies, at)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), COLORS),
        ax=axes,
        format=PercentFormatter(1.0),
        shrink=min(1.0, 9 / max(len(worlds), LEAST_ROWS)),
    )
    bar.set_label("share of robots that fall")
    missing = len(cells) < len(worlds) * len(policies)
    caption = _caption(table, TRAINING in worlds, missing)
    figure.supxlabel(textwrap.fill(caption, round(17 * size[0])), fontsize=7)
    figure.suptitle(textwrap.fill(title, round(15 * size[0])), fontsize=8)
    return figure


@styled
def fall_overview(tables: Mapping[str, pd.DataFrame]) -> Figure:
    """Draws the maps of several gaits side by side, a column a gait and policy, worst world first.

    Which is worst is decided by the policies that all gaits have: a page of one gait moves no row.

    Args:
        tables: What `fall_table` returned, by the gait.
    """
    whole = pd.concat([table.assign(gait=gait) for gait, table in tables.items()])
    common = set.intersection(*(set(table["policy"]) for table in tables.values()))
    worlds = worst_first(whole, common)
    robots = whole.groupby("scenario")["robots"].min()
    named = whole.drop_duplicates("scenario").set_index("scenario")["world"]
    counts = [len(policies_of(table)) for table in tables.values()]
    size = (2.0 + NARROW_COLUMN * (sum(counts) + len(counts)), 1.8 + ROW * len(worlds))
    figure, panels = subplots(
        1, len(tables), figsize=size, squeeze=False, sharey=True, width_ratios=counts
    )
    for axes, (gait, table) in zip(panels[0], tables.items(), strict=True):
        policies = policies_of(table)
        cells = {(cell["scenario"], cell["policy"]): cell for cell in table.to_dict("records")}
        for (row, world), (x, policy) in product(enumerate(worlds), enumerate(policies)):
            _draw_cell(axes, x, row, cells.get((world, policy)))
        if TRAINING in worlds:
            _frame(axes, worlds.index(TRAINING), len(policies) - 1)
        axes.set(xlim=(-0.55, len(policies) - 0.45), ylim=(len(worlds) - 0.45, -0.55))
        _plain(axes)
        titles = [policy_title(name) for name in policies]
        axes.set_xticks(range(len(policies)), titles, fontsize=6.5, rotation=90)
        axes.set_title(gait.replace("_", "-"), fontsize=8)
    most = int(whole["robots"].max())
    _name_rows(
        panels[0, 0], worlds, [named[world] + _fewer(robots[world], most) for world in worlds]
    )
    missing = any(
        len(table) < len(worlds) * count
        for table, count in zip(tables.values(), counts, strict=True)
    )
    caption = _caption(whole, TRAINING in worlds, missing)
    figure.supxlabel(textwrap.fill(caption, round(17 * size[0])), fontsize=7)
    return figure


def readable_on(color: tuple[float, float, float]) -> str:
    """Returns black or white, whichever stands out more from a colour."""
    return ink_on(to_hex(color))


def _draw_cell(axes: Axes, x: float, row: int, cell: dict[Any, Any] | None) -> None:
    """Draws a policy in a world: its colour, and how many fell; hatched where nobody was there."""
    if cell is None:
        look = {"facecolor": "0.88", "edgecolor": "0.55", "hatch": "//////", "linewidth": 0.0}
        axes.add_patch(Rectangle((x - 0.5, row - 0.5), 1, 1, **look))
        return
    color = COLORS(cell["fall_rate"])[:3] if cell["falls"] else (1.0, 1.0, 1.0)
    look = {"facecolor": color, "edgecolor": "0.85", "linewidth": 0.5}
    axes.add_patch(Rectangle((x - 0.5, row - 0.5), 1, 1, **look))
    text, ink = (str(cell["falls"]), readable_on(color)) if cell["falls"] else ("·", "0.4")
    axes.text(x, row, text, color=ink, fontsize=7, ha="center", va="center")


def _frame(axes: Axes, row: int, last: float) -> None:
    axes.add_patch(
        Rectangle((-0.5, row - 0.5), last + 1, 1, fill=False, edgecolor="black", linewidth=1.2)
    )


def _name_rows_and_columns(
    axes: Axes, table: pd.DataFrame, worlds: list[str], policies: list[str], at: list[float]
) -> None:
    axes.set(xlim=(-0.55, at[-1] + 0.55), ylim=(len(worlds) - 0.45, -0.55))
    _plain(axes)
    axes.set_xticks(at, [textwrap.fill(policy_title(name), 11) for name in policies], fontsize=6.5)
    named = table.drop_duplicates("scenario").set_index("scenario").loc[worlds]
    robots = [_fewer(count, table["robots"].max()) for count in named["robots"]]
    _name_rows(
        axes, worlds, [f"{name}{count}" for name, count in zip(named["world"], robots, strict=True)]
    )


def _plain(axes: Axes) -> None:
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    axes.xaxis.tick_top()


def _name_rows(axes: Axes, worlds: list[str], names: list[str]) -> None:
    axes.set_yticks(range(len(worlds)), [textwrap.fill(name, 40) for name in names])
    for label, world in zip(axes.get_yticklabels(), worlds, strict=True):
        label.set_fontweight("bold" if world == TRAINING else "normal")


def _fewer(robots: int, most: int) -> str:
    """Returns how many robots there were, where there were fewer than elsewhere."""
    return "" if robots == most else f" ({robots} robot{'s' if robots > 1 else ''})"


def _caption(table: pd.DataFrame, in_distribution: bool, missing: bool) -> str:
    most, least = table["robots"].max(), table["robots"].min()
    parts = [f"{most} robot{'s' if most > 1 else ''} of each policy in each scenario"]
    if least < most:
        parts[0] += ", fewer where the row says so"
    parts.append("the numbers are those that fall, ·\N{NO-BREAK SPACE}is none")
    if in_distribution:
        parts.append("framed: the training scenario")
    if missing:
        parts.append("hatched: not rolled out")
    return "; ".join(parts) + "."


def worst_first(table: pd.DataFrame, policies: Collection[str] = ()) -> list[str]:
    """Lists the scenarios by the share of robots that fall, the greatest first.

    Args:
        table: Falls, a row a policy and scenario.
        policies: Whose robots are counted; by default those of all.

    Returns:
        All scenarios of the table; those of one share stay in its order.
    """
    scenarios = table["scenario"].unique()
    counted = table[table["policy"].isin(policies)] if policies else table
    sums = counted.groupby("scenario")[["falls", "robots"]].sum().reindex(scenarios)
    shares = sums["falls"] / sums["robots"]
    return shares.sort_values(ascending=False, kind="stable").index.tolist()


def policies_of(table: pd.DataFrame) -> list[str]:
    """Lists the policies of a table as they come, but for the expert, which is the first."""
    there = list(dict.fromkeys(table["policy"]))
    return sorted(there, key=lambda name: name != EXPERT)
