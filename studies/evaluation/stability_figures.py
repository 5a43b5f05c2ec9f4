"""The picture of the stride map: spectral radii by command and by rhythm, and the eigenvalues."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from glassgait.models.arrays import Array
from glassgait.studies.common.figures import COLUMN_WIDTH, styled
from glassgait.studies.distillation.students.registry import (
    policy_color,
    policy_marker,
    policy_title,
)

COLORS = mpl.colormaps["RdBu_r"]
"""Blue where differences shrink, red where they grow, white in between."""

SCALE = TwoSlopeNorm(1.0, 0.4, 1.6)
"""Spectral radii that the colours span."""

Records = Sequence[Mapping[str, Any]]


@styled
def stability_figure(results: Mapping[str, Records], name: str) -> Figure:
    """Draws what the stride map says of each policy.

    Args:
        results: Records of `analyse`, by policy.
        name: What the gait is called.
    """
    n = len(results)
    figure = Figure(figsize=(max(1.3 * COLUMN_WIDTH, 1.35 * n + 1.2), 5.6))
    parts: Any = figure.subfigures(3, 1, height_ratios=(1.25, 1.15, 1.3))
    top, middle, bottom = parts
    maps, circles = (part.subplots(1, n, sharey=True, squeeze=False)[0] for part in (top, middle))
    reach = max(
        1.3, *(1.1 * np.abs(_eigenvalues(records)).max(initial=0.0) for records in results.values())
    )
    for axes, circle, (policy, records) in zip(maps, circles, results.items(), strict=True):
        _draw_map(axes, records)
        axes.set_title(policy_title(policy), fontsize=7.5)
        _draw_circle(circle, records, reach)
    maps[0].set_ylabel("yaw rate\n(rad/s)")
    circles[0].set_ylabel("imaginary part")
    bar = top.colorbar(ScalarMappable(SCALE, COLORS), ax=maps, shrink=0.9, pad=0.01)
    bar.set_label("spectral radius", fontsize=7)
    lines = bottom.subplots()
    _draw_rhythm(lines, results)
    figure.suptitle(
        f"{name}: what a small difference becomes in a stride. Above 1 it grows, below it fades",
        fontsize=8,
    )
    return figure


def _draw_map(axes: Axes, records: Records) -> None:
    """Draws a cell for each speed and yaw rate; hatched where there is no derivative."""
    grid = grid_of(records)
    speeds = sorted({record["speed"] for record in grid})
    rates = sorted({record["yaw_rate"] for record in grid})
    for record in grid:
        x, y = speeds.index(record["speed"]), rates.index(record["yaw_rate"])
        corner = (x - 0.5, y - 0.5)
        if not believed(record):
            look = {"facecolor": "0.9", "edgecolor": "0.6", "hatch": "/////", "linewidth": 0.0}
            axes.add_patch(Rectangle(corner, 1, 1, **look))
            continue
        radius = record["radius"]
        color = COLORS(SCALE(radius))
        axes.add_patch(Rectangle(corner, 1, 1, facecolor=color, edgecolor="white"))
        ink = "white" if abs(SCALE(radius) - 0.5) > 0.36 else "black"
        axes.text(x, y, f"{radius:.2f}", color=ink, fontsize=6.5, ha="center", va="center")
    axes.set(xlim=(-0.5, len(speeds) - 0.5), ylim=(-0.5, len(rates) - 0.5))
    axes.set_xticks(range(len(speeds)), [f"{speed:g}" for speed in speeds])
    axes.set_yticks(range(len(rates)), [f"{rate:g}" for rate in rates])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    axes.set_xlabel("speed (m/s)", fontsize=7)


def _eigenvalues(records: Records) -> Array:
    """Returns real and imaginary parts (n, 2) of the eigenvalues of all commands; n may be 0."""
    own = [record["eigenvalues"] for record in records if believed(record)]
    return np.array(own, dtype=float).reshape(-1, 2)


def _draw_circle(axes: Axes, records: Records, reach: float) -> None:
    """Draws the eigenvalues of all commands beside the unit circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    axes.fill(np.cos(angle), np.sin(angle), color="0.95", linewidth=0)
    axes.plot(np.cos(angle), np.sin(angle), color="0.5", linewidth=0.7)
    values = _eigenvalues(records)
    if len(values):
        outside = np.hypot(*values.T) > 1.0
        axes.plot(*values[~outside].T, ".", color="#0072B2", markersize=2.5, alpha=0.6)
        axes.plot(*values[outside].T, ".", color="#D55E00", markersize=4)
    else:
        axes.text(0, 0, "no derivative", fontsize=6.5, color="0.4", ha="center", va="center")
    # Wide enough that no eigenvalue of any policy is left out.
    wide = 1.25 * reach
    axes.set(xlim=(-wide, wide), ylim=(-reach, reach), aspect="equal", xlabel="real part")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(4, integer=True))


def _draw_rhythm(axes: Axes, results: Mapping[str, Records]) -> None:
    """Draws radii over the dwell: filled of the derivative, hollow of differences of a size."""
    for policy, records in results.items():
        middle = sorted(rhythm_of(records), key=lambda record: record["dwell"])
        sure = [record for record in middle if believed(record)]
        look = {"color": policy_color(policy), "marker": policy_marker(policy), "markersize": 3.5}
        axes.plot(
            [record["dwell"] for record in sure],
            [record["radius"] for record in sure],
            linewidth=1.0,
            label=policy_title(policy),
            **look,
        )
        known = [record for record in middle if "averaged_radius" in record]
        axes.plot(
            [record["dwell"] for record in known],
            [record["averaged_radius"] for record in known],
            linewidth=0.6,
            linestyle=":",
            markerfacecolor="white",
            **look,
        )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.axhline(1.0, color="0.5", linewidth=0.7, zorder=0)
    axes.set(xlabel="commanded dwell (control steps)", ylabel="spectral radius")
    axes.set_ylim(bottom=0.0)
    axes.legend(
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
        title="filled: derivative\nhollow: differences\nof 0.01 rad, averaged",
        title_fontsize=6.5,
    )


def grid_of(records: Records) -> list[Mapping[str, Any]]:
    """Returns the records of the grid of speeds and yaw rates: all of the first one's dwell."""
    return [record for record in records if record["dwell"] == records[0]["dwell"]]


def rhythm_of(records: Records) -> list[Mapping[str, Any]]:
    """Returns the records that differ in the dwell alone, that of the grid among them."""
    last = records[-1]
    same = (last["speed"], last["yaw_rate"])
    return [record for record in records if (record["speed"], record["yaw_rate"]) == same]


AGREED = 0.02
"""How far radii of the step sizes may lie apart (share) for a derivative to be believed."""


def believed(record: Mapping[str, Any]) -> bool:
    """Returns whether a fixed point was found and its spectral radius agrees over step sizes."""
    radius = record.get("radius", float("nan"))
    return bool(2.0 * radius_error(record) <= AGREED * radius)


def radius_error(record: Mapping[str, Any]) -> float:
    """Returns half the spread of the spectral radius over the step sizes."""
    radii = np.array(record.get("radii", [np.nan]))
    return float(0.5 * (radii.max() - radii.min()))
