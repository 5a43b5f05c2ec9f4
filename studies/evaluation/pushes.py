"""`glassgait evaluate pushes`: which pushes walking robots survive, from every side."""

import textwrap
from collections.abc import Mapping
from dataclasses import field, replace
from itertools import product
from typing import Annotated, Any, ClassVar

import matplotlib as mpl
import numpy as np
import pandas as pd
from annotated_types import Ge, Gt, Le, MinLen
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import PercentFormatter

from glassgait.diagrams.commands import FixedCommand
from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, FEW, Count, checked
from glassgait.studies.common.cases import Case
from glassgait.studies.common.experiment import Experiment, Report
from glassgait.studies.common.figures import styled
from glassgait.studies.common.scores import wilson_interval
from glassgait.studies.common.tables import json_records
from glassgait.studies.distillation.students import policy_title
from glassgait.studies.evaluation.pushing import Basin, PushGrid, failure_counts, push_everywhere

PushSpeed = Annotated[float, Gt(0.0), Le(20.0)]

Steps = Annotated[int, Ge(50), Le(450)]
"""Control steps from the push to the end: at least a second, in which a robot must walk; a new
command comes after ten seconds."""


@checked
class Pushes(Experiment):
    """Push walking robots from every side, and draw which pushes each policy survives.

    Attributes:
        command: What the robots are commanded.
        n_phases: Instants of the gait's cycle in which robots are pushed.
        n_steps: Control steps from the push until a robot must still walk.
        n_directions: Directions of pushes, equally far apart.
        speeds: What a push adds to the trunk's velocity (m/s).
    """

    title: ClassVar[str] = "evaluate pushes"
    one: ClassVar[tuple[str, ...]] = ("scenario",)
    discrete: ClassVar[bool] = True
    n_robots: ClassVar[int] = 1
    n_seeds: ClassVar[int] = 1

    command: FixedCommand = field(default_factory=FixedCommand)
    n_phases: Annotated[Count, Le(1000)] = 8
    n_steps: Steps = 250
    n_directions: Annotated[Count, Ge(3), Le(360)] = 12
    speeds: Annotated[tuple[PushSpeed, ...], MinLen(1), FEW, DISTINCT] = (
        0.3,
        0.6,
        0.9,
        1.2,
        1.5,
        1.8,
        2.1,
        2.4,
        2.7,
        3.0,
    )

    def __post_init__(self) -> None:
        if list(self.speeds) != sorted(self.speeds):
            raise InputError(f"{self.title}: speeds is {self.speeds}; name the least first")

    def measure(self, case: Case) -> pd.DataFrame:
        """Pushes the robots of one policy: a row of counts by direction, speed and kind of end."""
        pushed = push_everywhere(
            case.gait,
            case.alone,
            replace(case.scenario, command=self.command),
            self._grid(),
            n_steps=self.n_steps,
            seed=case.seed,
        )
        survived = pushed.survived.sum(axis=2).tolist()
        return pd.DataFrame([{"survived": survived, "failures": failure_counts(pushed)}])

    def report(self, table: pd.DataFrame) -> Report:
        """Reports which pushes each policy survives."""
        basins = {
            row["policy"]: Basin(self._grid(), np.array(row["survived"]), row["failures"])
            for row in table.to_dict(orient="records")
        }
        summed, gait = summary_table(basins), table["gait"].iloc[0]
        title = (
            f"{gait.capitalize()} at {self.command.speed:g} m/s: which pushes are survived. "
            f"Direction as angle, speed (m/s) as radius; the line is where half survive"
        )
        return Report(
            tables={"summary": summed, "pushes": push_table(basins)},
            metrics=json_records(summed),
            figures={"pushes": push_figure(basins, title)},
            shown={f"{gait}: pushes": summed},
        )

    def _grid(self) -> PushGrid:
        directions = 2.0 * np.pi * np.arange(self.n_directions) / self.n_directions
        return PushGrid(directions, np.array(self.speeds), self.n_phases)


def summary_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Makes a row of each policy."""
    rows = []
    for policy, basin in basins.items():
        n_pushes = int(np.prod(basin.grid.shape))
        survived = int(basin.survived.sum())
        low, high = wilson_interval(survived, n_pushes)
        means = basin.shares.mean(axis=1)
        weakest = basin.grid.directions[means == means.min()]
        ends = sorted(basin.failures.items(), key=lambda end: -end[1])
        row: dict[str, Any] = {
            "policy": policy_title(policy),
            "all survived up to (m/s)": basin.all_up_to,
            "half survived up to (m/s)": basin.half_up_to,
            "survived": f"{survived} of {n_pushes}",
            "share": survived / n_pushes,
            "95 % from": low,
            "95 % to": high,
            "weakest direction": ", ".join(f"{np.degrees(own):.0f}°" for own in weakest),
            "how the others ended": ", ".join(
                f"{name.replace('_', ' ')} {count}" for name, count in ends if count
            )
            or "–",
        }
        rows.append(row)
    return pd.DataFrame(rows)


def push_table(basins: Mapping[str, Basin]) -> pd.DataFrame:
    """Makes a row of each policy, direction and speed."""
    rows = []
    for policy, basin in basins.items():
        for i, direction in enumerate(basin.grid.directions):
            for j, speed in enumerate(basin.grid.speeds):
                survived = int(basin.survived[i, j])
                low, high = wilson_interval(survived, basin.grid.n_phases)
                rows.append(
                    {
                        "policy": policy_title(policy),
                        "direction (°)": round(float(np.degrees(direction)), 6),
                        "speed (m/s)": float(speed),
                        "robots": basin.grid.n_phases,
                        "survived": survived,
                        "share": survived / basin.grid.n_phases,
                        "95 % from": low,
                        "95 % to": high,
                    }
                )
    return pd.DataFrame(rows)


COLORS = mpl.colormaps["YlGnBu"]
"""Of one direction, from light where none survives to dark where all do."""

PANEL = 1.95
"""Width of a policy's panel (inches)."""

HOLE = 0.22
"""Radius of the hole in the middle, where the robot stands (shares of the rings' width)."""

MOST_COLUMNS = 5
"""Panels side by side at most."""

SIDES = ("ahead", "left", "back", "right")


@styled
def push_figure(basins: Mapping[str, Basin], title: str) -> Figure:
    """Draws a disc of each policy: direction as angle, speed as radius, colour for survival.

    The line is where half survive. The robot stands in the middle and faces upward.

    Args:
        basins: What each policy survives, the expert first.
        title: What stands above.
    """
    columns = min(len(basins), MOST_COLUMNS)
    rows = -(-len(basins) // columns)
    figure = Figure(figsize=(PANEL * columns + 0.7, (PANEL + 0.2) * rows + 0.4))
    panels = figure.subplots(
        rows, columns, squeeze=False, subplot_kw={"projection": "polar"}
    ).ravel()
    for axes in panels[len(basins) :]:
        axes.set_visible(False)
    for axes, (policy, basin) in zip(panels, basins.items(), strict=False):
        _draw_basin(axes, basin)
        name = policy_title(policy)
        axes.set_title(f"{name}\nall survived up to {basin.all_up_to:.2g} m/s", fontsize=7.5)
    bar = figure.colorbar(
        ScalarMappable(Normalize(0, 1), COLORS),
        ax=panels.tolist(),
        format=PercentFormatter(1.0),
        shrink=0.7,
        pad=0.02,
    )
    bar.set_label("share of phases survived")
    bar.outline.set_visible(False)  # type: ignore[operator]
    figure.suptitle(textwrap.fill(title, round(18 * (PANEL * columns + 0.7))), fontsize=8)
    return figure


def _draw_basin(axes: Axes, basin: Basin) -> None:
    directions, speeds, shares = basin.grid.directions, basin.grid.speeds, basin.shares
    rings = _rings(speeds)
    axes.set_theta_zero_location("N")  # type: ignore[attr-defined]
    axes.set_rorigin(rings[0] - HOLE * (rings[-1] - rings[0]))  # type: ignore[attr-defined]
    width = 2.0 * np.pi / len(directions)
    for column, low, high in zip(shares.T, rings[:-1], rings[1:], strict=True):
        look = {"color": COLORS(column), "edgecolor": "white", "linewidth": 0.35}
        axes.bar(directions, high - low, width=width, bottom=low, **look)
    around = np.append(directions, directions[0] + 2 * np.pi)
    halves = half_lines(speeds, shares)
    axes.plot(around, np.append(halves, halves[0]), color="#D55E00", linewidth=1.1, zorder=4)
    axes.set_ylim(rings[0], rings[-1])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_xticks(np.arange(4) * np.pi / 2, SIDES, fontsize=6.5)
    axes.tick_params(pad=-2)
    axes.set_yticks([])
    circle = np.linspace(0.0, 2.0 * np.pi, 181)
    for speed in np.arange(1.0, rings[-1]):
        if speed > rings[0]:
            axes.plot(circle, np.full(181, speed), color="0.35", linewidth=0.4, zorder=3)
            # On a line between two sides, where no word stands.
            text = axes.text(-np.pi / 4, speed, f"{speed:g}", fontsize=6, ha="center", va="center")
            text.set_path_effects([withStroke(linewidth=1.6, foreground="white")])
    _draw_robot(axes)


def _rings(speeds: Array) -> Array:
    """Returns the borders between the rings of speeds, inner and outer ones with them."""
    if len(speeds) == 1:
        return speeds[0] * np.array([0.5, 1.5])
    middles = 0.5 * (speeds[:-1] + speeds[1:])
    inner, outer = 2.0 * speeds[0] - middles[0], 2.0 * speeds[-1] - middles[-1]
    return np.concatenate([[max(inner, 0.0)], middles, [outer]])


def half_lines(speeds: Array, shares: Array) -> Array:
    """Finds where, from the middle outward, fewer than half survive for the first time.

    Args:
        speeds: Speeds of pushes (n_speeds,; m/s).
        shares: Shares that survive (n_directions, n_speeds).

    Returns:
        Speeds between those of the grid, linearly (n_directions,; m/s); the greatest where at least
        half survive them all.
    """
    found = []
    for own in shares:
        below = np.flatnonzero(own < 0.5)
        if len(below) == 0:
            found.append(speeds[-1])
            continue
        after = below[0]
        if after == 0:
            found.append(speeds[0])
            continue
        high, low = own[after - 1], own[after]
        part = (high - 0.5) / (high - low)
        found.append(speeds[after - 1] + part * (speeds[after] - speeds[after - 1]))
    return np.array(found)


def _draw_robot(axes: Axes) -> None:
    """Draws the robot from above into the hole: its trunk, its feet, and where it faces."""
    length, width = 0.1, 0.05
    look = {"transform": axes.transAxes, "clip_on": False, "zorder": 5}
    trunk = FancyBboxPatch(
        (0.5 - width / 2, 0.5 - length / 2),
        width,
        length,
        boxstyle="round,pad=0,rounding_size=0.02",
        facecolor="0.25",
        linewidth=0,
        **look,
    )
    axes.add_artist(trunk)
    for x, y in product((-0.75, 0.75), (-0.5, 0.5)):
        foot = (0.5 + x * width, 0.5 + y * length)
        axes.add_artist(Line2D(*zip(foot, strict=True), marker="o", color="0.25", ms=1.8, **look))
    nose = ([0.5], [0.5 + 0.36 * length])
    axes.add_artist(Line2D(*nose, marker="^", color="#D55E00", ms=2.6, mew=0, **look))
