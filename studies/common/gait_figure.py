"""The gait diagram: which feet touch the ground, and in which state the reward machine is."""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from glassgait.diagrams.rollout import Rollout
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.palette import ink_on, state_colors
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots


@styled
def gait_figure(rollout: Rollout, gait: Gait, title: str, seconds: float = 2.0) -> Figure:
    """Feet in contact over time, with the reward machine's states as bands."""
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 1.5))
    last = rollout.time[-1]
    draw_gait(axes, rollout, gait)
    axes.set_xlim(max(0.0, last - seconds), last)
    axes.set_title(title)
    return figure


@styled
def session_figure(
    rollout: Rollout, switch: GaitSwitch, title: str, seconds: float = 2.0
) -> Figure:
    """Which of several gaits runs over time, and below it the gait diagram of each that ran.

    A gait's diagram is the end of its longest run, `seconds` at most.
    """
    states = rollout["rm_state"]
    running = switch.gait_of(states.argmax(axis=1))
    stretches = _runs(running)
    longest: dict[int, tuple[int, int]] = {}
    for start, stop in stretches:
        before = longest.get(running[start], (0, 0))
        if stop - start > before[1] - before[0]:
            longest[running[start]] = (start, stop)
    n_rows = 1 + len(longest)
    figure, (top, *rows) = subplots(
        n_rows,
        figsize=(2 * COLUMN_WIDTH, 0.6 + 0.16 * len(switch.gaits) + 1.4 * len(longest)),
        height_ratios=[0.3 + 0.13 * len(switch.gaits), *(1.0 for _ in longest)],
    )
    for start, stop in stretches:
        bar = (rollout.time[start], (stop - start) * CONTROL_PERIOD)
        top.broken_barh([bar], (running[start] - 0.4, 0.8), color="0.15", linewidth=0)
    top.set_yticks(range(len(switch.gaits)), [gait.name for gait in switch.gaits])
    top.set(
        xlim=(rollout.time[0], rollout.time[-1]), ylim=(len(switch.gaits) - 0.4, -0.6), title=title
    )
    top.grid(visible=False, axis="y")
    offsets = np.cumsum([0, *(gait.n_states for gait in switch.gaits)])
    for axes, (number, (start, stop)) in zip(rows, longest.items(), strict=True):
        gait = switch.gaits[number]
        shown = slice(max(start, stop - round(seconds / CONTROL_PERIOD)), stop)
        own = {
            "rm_state": states[shown, offsets[number] : offsets[number + 1]],
            "foot_contact": rollout["foot_contact"][shown],
        }
        draw_gait(axes, Rollout(rollout.time[shown], own), gait)
        begin = rollout.time[shown.start]
        axes.set(title=gait.name, xlim=(begin, begin + seconds))
        if axes is not rows[-1]:
            axes.set_xlabel("")
    return figure


def strip_data(rollout: Rollout, gait: Gait) -> dict[str, Any]:
    """Returns what a page's gait strip shows of a rollout, as JSON has it; see `player.js`."""
    colors = state_colors(gait)
    return {
        "period": CONTROL_PERIOD,
        "legs": quadruped.LEGS,
        "states": gait.states,
        "colors": colors,
        "inks": [ink_on(color) for color in colors],
        "state": rollout["rm_state"].argmax(axis=1).tolist(),
        "contact": (rollout["foot_contact"] > 0.5).astype(int).tolist(),
    }


def draw_gait(axes: Axes, rollout: Rollout, gait: Gait) -> None:
    """Draws the gait diagram of a whole rollout."""
    states, colors = rollout["rm_state"].argmax(axis=1), state_colors(gait)
    for start, stop in _runs(states):
        axes.axvspan(
            rollout.time[start],
            rollout.time[start] + (stop - start) * CONTROL_PERIOD,
            color=colors[states[start]],
            alpha=0.25,
            linewidth=0,
        )
    for row in range(quadruped.N_LEGS):
        touches = rollout["foot_contact"][:, row] > 0.5
        bars = [
            (rollout.time[start], (stop - start) * CONTROL_PERIOD)
            for start, stop in _runs(touches)
            if touches[start]
        ]
        axes.broken_barh(bars, (row - 0.35, 0.7), color="0.15", linewidth=0)
    axes.set_yticks(range(quadruped.N_LEGS), quadruped.LEGS)
    axes.set(xlabel="time (s)", ylim=(quadruped.N_LEGS - 0.4, -0.6))
    axes.grid(visible=False)
    handles = [
        Patch(color=color, alpha=0.25, label=name)
        for name, color in zip(gait.states, colors, strict=True)
    ]
    handles.insert(0, Patch(color="0.15", label="contact"))
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Finds the stretches [start, stop) of equal values."""
    edges = np.flatnonzero(np.diff(values)) + 1
    borders = [0, *edges.tolist(), len(values)]
    return list(pairwise(borders))
