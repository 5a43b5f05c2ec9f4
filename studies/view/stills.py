"""The paper's gait figure: stills over one cycle of the machine, above the feet's contacts."""

import numpy as np
from matplotlib.figure import Figure

from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.visualization import Camera
from glassgait.models.errors import InputError
from glassgait.models.robots.robot import Robot
from glassgait.models.task.drawing import state_colors
from glassgait.models.task.gait import Gait
from glassgait.studies.common.figures import COLUMN_WIDTH, draw_gait, styled


def last_cycle(rollout: Rollout, gait: Gait) -> tuple[int, int]:
    """Returns the steps [start, stop) between the last two entries of the initial state."""
    initial = rollout["rm_state"][:, gait.states.index(gait.initial)] > 0.5
    entries = np.flatnonzero(initial[1:] & ~initial[:-1]) + 1
    if len(entries) < 2:
        raise InputError("the rollout holds no whole cycle of the gait; roll out for longer")
    return int(entries[-2]), int(entries[-1])


@styled
def gait_strip(robot: Robot, rollout: Rollout, gait: Gait, n_stills: int = 8) -> Figure:
    """Draws stills of the last cycle above the gait diagram, framed in the RM states' colours."""
    # Space the stills evenly over the cycle.
    start, stop = last_cycle(rollout, gait)
    middles = (np.arange(n_stills) + 0.5) / n_stills
    steps = start + np.floor(middles * (stop - start)).astype(int)

    # Draw the stills in the upper row, cropped to the robot.
    camera = Camera(robot, 480, 320)
    figure = Figure(figsize=(2 * COLUMN_WIDTH, 2.2))
    grid = figure.add_gridspec(2, n_stills, height_ratios=(1.0, 1.3))
    colors = state_colors(gait)
    for column, step in enumerate(steps):
        axes = figure.add_subplot(grid[0, column])
        axes.imshow(camera.take(rollout["state"][step])[32:288, 80:400])
        axes.set(xticks=[], yticks=[])
        axes.grid(visible=False)
        milliseconds = 1000.0 * (rollout.time[step] - rollout.time[start])
        axes.set_title(f"{milliseconds:.0f} ms", fontsize=6, pad=2)
        color = colors[rollout["rm_state"][step].argmax()]
        for side in axes.spines.values():
            side.set(visible=True, color=color, linewidth=1.5)

    # Draw the diagram below, with a line at each still's instant.
    axes = figure.add_subplot(grid[1, :])
    draw_gait(axes, rollout, gait)
    axes.set_xlim(rollout.time[start], rollout.time[stop])
    for step in steps:
        axes.axvline(float(rollout.time[step]), color="0.3", linewidth=0.5, linestyle=":")
    return figure
