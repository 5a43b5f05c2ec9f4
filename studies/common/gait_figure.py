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
from glassgait.models.task.drawing import ink_on, state_colors
from glassgait.models.task.gait import Gait
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
