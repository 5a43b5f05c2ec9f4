"""Figures of runtime assurance: falls against calls, and one robot that is pushed."""

from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import push
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController, Controller
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots
from glassgait.studies.evaluation.assurance_calibration import Calibration

SPEED = 0.5
"""Commanded speed (m/s)."""

SECONDS = 4.0
"""Length of a rollout (s)."""

PUSH = 1.0
"""What a push adds along each horizontal axis (m/s), with either sign."""

INSTANTS = tuple(range(60, 76, 3))
"""Control steps at which it is tried, over a cycle of the gait."""


def push_one(gait: Gait, alone: AlternatingController, calibration: Calibration) -> dict[str, Any]:
    """Pushes one robot until the student alone falls, and then once more under assurance.

    Directions are diagonals, as strong as the world of pushes has them. Where the student never
    falls, the push that ends the highest overrun is shown.

    Args:
        gait: The gait.
        alone: The student alone.
        calibration: The region and the limits, of which those of most calls are taken.

    Returns:
        `push`, the control step of the push and its velocity (m/s), and of `alone` and `assured`
        the trunk's `height` (m), the `overrun` and `expert_acts`, a value a control instant, and
        whether it `fell`.
    """
    tried = []
    for step, x, y in product(INSTANTS, (-PUSH, PUSH), (-PUSH, PUSH)):
        velocity = np.array([x, y, 0.0])
        rollout = _pushed(gait, alone, step, velocity)
        worst = float(calibration.region.overrun(rollout["observations"]).max())
        tried.append((rollout.failed, worst, step, velocity, rollout))
        if rollout.failed:
            break
    _, _, step, velocity, rollout = max(tried, key=lambda one: one[:2])
    assured = calibration.assured(alone, max(calibration.hysteresis))
    guarded = _pushed(gait, assured, step, velocity)
    return {
        "push": [step, velocity.tolist()],
        "alone": _outcome(rollout, calibration),
        "assured": _outcome(guarded, calibration),
    }


def _pushed(gait: Gait, policy: Controller, step: int, velocity: Array) -> Rollout:
    diagram = MakeLocomotion(gait, Scenario(command=FixedCommand(speed=SPEED)), policy=policy)
    simulator = make_simulator(diagram)

    def pushed() -> bool:
        # Between two control steps, as pushes come in the batch simulator.
        if round(simulator.get_context().get_time() / CONTROL_PERIOD) == step:
            push(diagram, simulator.get_mutable_context(), velocity)
        return False

    return record(simulator, round(SECONDS / CONTROL_PERIOD), stopped=pushed)


def _outcome(rollout: Rollout, calibration: Calibration) -> dict[str, Any]:
    overrun = calibration.region.overrun(rollout["observations"])
    acts = rollout.values.get("expert_acts", np.zeros((len(overrun), 1)))
    return {
        "height": rollout["state"][:, quadruped.POSITION][:, 2].tolist(),
        "overrun": np.minimum(overrun, 100.0).tolist(),
        "expert_acts": acts[:, 0].tolist(),
        "fell": rollout.failed,
    }


LOOKS = {
    "schedule": ("s", "0.55", "every n-th step"),
    "assured": ("o", "#0072B2", "outside of the region"),
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
        ("assured", "#0072B2", "assured"),
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
            color="#0072B2",
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
