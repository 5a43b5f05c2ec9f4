"""Falls against calls, and one robot that is pushed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.evaluation.assurance.study import Calibration

LOOKS = {
    "schedule": ("s", "0.55", "every n-th step"),
    "assured": ("o", "tab:blue", "outside of the region"),
}
"""Marker, colour and title of the policies that share the steps."""


@styled
def draw_calls(table: pd.DataFrame, titles: Mapping[str, str]) -> Figure:
    """Draws falls against the share of steps that the expert acts in, a panel a world.

    Args:
        table: What `assurance_table` returned.
        titles: What people call each scenario.
    """
    size = (COLUMN_WIDTH, 0.6 + 1.6 * len(titles))
    figure, panels = subplots(len(titles), 1, figsize=size, squeeze=False, sharex=True)
    for axes, name in zip(panels[:, 0], titles, strict=True):
        own = table[table["scenario"] == name].sort_values("called")
        for kind, look in LOOKS.items():
            _draw_policies(axes, own[own["policy"].str.startswith(f"{kind}_")], *look)
        shared = own["policy"].str.startswith(("assured_", "schedule_"))
        _draw_policies(axes, own[~shared & (own["policy"] != "expert")], "X", "tab:red", "student")
        expert = own[own["policy"] == "expert"].iloc[0]
        axes.axhline(expert["fall_rate"], color="black", linewidth=0.8, label="expert")
        axes.axhspan(
            expert["fall_rate_low"], expert["fall_rate_high"], color="black", alpha=0.08, lw=0
        )
        axes.set_title(f"{titles[name]}: {expert['robots']} robots")
        axes.set_ylabel("share that falls")
        axes.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
        axes.xaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
        axes.set_ylim(bottom=0.0)
    panels[0, 0].legend()
    panels[-1, 0].set_xlabel("share of steps that the expert acts in")
    return figure


def _draw_policies(axes: Axes, rows: pd.DataFrame, marker: str, color: str, title: str) -> None:
    rate = rows["fall_rate"].to_numpy()
    ends = np.abs(rows[["fall_rate_low", "fall_rate_high"]].to_numpy().T - rate)
    axes.errorbar(
        rows["called"],
        rate,
        yerr=ends,
        fmt=marker,
        color=color,
        markersize=4,
        elinewidth=0.8,
        label=title,
    )


@styled
def draw_pushed(shown: Mapping[str, Any], calibration: Calibration) -> Figure:
    """Draws one robot that is pushed over time: height, overrun, and when the expert acts.

    Args:
        shown: What `push_one` returned.
        calibration: Where the limit is drawn from.
    """
    figure, panels = subplots(2, 1, figsize=(COLUMN_WIDTH, 2.8), sharex=True)
    step, velocity = shown["push"]
    for name, color, title in (
        ("alone", "tab:red", "student alone"),
        ("assured", "tab:blue", "assured"),
    ):
        own = shown[name]
        time = CONTROL_PERIOD * np.arange(len(own["height"]))
        panels[0].plot(time, own["height"], color=color, label=title)
        panels[1].plot(time, own["overrun"], color=color)
        if own["fell"]:
            panels[0].plot(time[-1], own["height"][-1], "x", color=color, label="falls")
    assured = shown["assured"]
    time = CONTROL_PERIOD * np.arange(len(assured["height"]))
    for axes in panels:
        acts = np.array(assured["expert_acts"]) > 0.5
        axes.fill_between(
            time,
            0,
            1,
            where=acts,
            step="post",
            transform=axes.get_xaxis_transform(),
            color="tab:blue",
            alpha=0.12,
            linewidth=0,
            label="expert acts",
        )
        axes.axvline(CONTROL_PERIOD * step, color="0.3", linestyle=":", linewidth=0.8)
    limit = calibration.hysteresis[max(calibration.hysteresis)].limit
    panels[1].axhline(limit, color="black", linewidth=0.8, label=f"limit {limit:.2f}")
    panels[0].set_ylabel("height of the trunk (m)")
    panels[1].set(ylabel="overrun (widths)", xlabel="time (s)")
    panels[0].legend(ncols=2)
    panels[1].legend()
    figure.suptitle(f"Pushed by {velocity[0]:+g}, {velocity[1]:+g} m/s", fontsize=8)
    return figure
