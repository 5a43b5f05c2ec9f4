"""The replay of two robots side by side, as a page that opens without a server."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat, MeshcatVisualizer
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from glassgait.diagrams.posed_robots import AddPosedRobots, paint
from glassgait.diagrams.replay import replay_page
from glassgait.diagrams.rollout import Rollout
from glassgait.diagrams.visualization import draw_ground, open_meshcat
from glassgait.models.arrays import Array
from glassgait.models.files import write_atomically
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.gait_display import PAVEMENT_PATH, TILE, WORLD_PATH

LANE = 1.0
"""Distance between where the two robots begin (m)."""


@dataclass(frozen=True)
class ReplayedRobot:
    """A robot of the replay.

    Attributes:
        name: Short name, by which Meshcat's tree lists it; letters alone.
        caption: What the page's legend says of it.
        color: Its colour, as hexadecimal red, green and blue.
        rollout: What it did.
        robot: What robot it is.
    """

    name: str
    caption: str
    color: str
    rollout: Rollout
    robot: Robot


def save_pair_replay(
    left: ReplayedRobot, right: ReplayedRobot, path: Path, *, repetitions: int = 1
) -> None:
    """Draws two rollouts into one animation and writes its page with a legend, atomically.

    The robots begin `LANE` apart, and the picture follows their middle. One that falls stays where
    it fell, and the picture goes on with the other.

    Args:
        left: The robot on the left.
        right: The robot on the right, of another name.
        path: HTML file of the replay.
        repetitions: How often it plays before it stands still.
    """
    meshcat, robots = open_meshcat(), (left, right)
    diagram, plant, instances = _make_display(meshcat, robots)
    places = _positions(left.rollout, LANE / 2), _positions(right.rollout, -LANE / 2)
    middle = middle_of_paths(*(positions[:, quadruped.POSITION][:, :2] for positions in places))
    context = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(context)
    meshcat.StartRecording(
        frames_per_second=1.0 / CONTROL_PERIOD, set_visualizations_while_recording=False
    )
    times = max((shown.rollout.time for shown in robots), key=len)
    for step, time in enumerate(times - times[0]):
        context.SetTime(time)
        for instance, positions in zip(instances, places, strict=True):
            # Where its rollout ended in a fall a robot stays as it was.
            plant.SetPositions(own, instance, positions[min(step, len(positions) - 1)])
        x, y = middle[step]
        meshcat.SetTransform(WORLD_PATH, RigidTransform([-x, -y, 0.0]), time)
        tiles = TILE * np.round(middle[step] / TILE)
        meshcat.SetTransform(PAVEMENT_PATH, RigidTransform([*tiles, 0.0]), time)
        diagram.ForcedPublish(context)
    meshcat.StopRecording()
    meshcat.get_mutable_recording().set_repetitions(repetitions)
    meshcat.PublishRecording()
    write_atomically(path, _with_legend(replay_page(meshcat), robots))


def middle_of_paths(left: Array, right: Array) -> Array:
    """Returns what is halfway between two paths, and then moves on with the longer one alone.

    Args:
        left: Places (n, 2; m).
        right: Places (m, 2; m).

    Returns:
        Places (max(n, m), 2; m), without a jump where the shorter path ends.
    """
    n = min(len(left), len(right))
    both = (left[:n] + right[:n]) / 2
    longer = max(left, right, key=len)
    return np.concatenate([both, both[-1] + longer[n:] - longer[n - 1]])


def _make_display(
    meshcat: Meshcat, robots: Sequence[ReplayedRobot]
) -> tuple[Diagram, MultibodyPlant, list[ModelInstanceIndex]]:
    """Builds a diagram that draws robots in their colours, and steps nothing."""
    builder = DiagramBuilder()
    models = {shown.name: shown.robot for shown in robots}
    plant, scene_graph, instances = AddPosedRobots(builder, models)
    for shown, instance in zip(robots, instances, strict=True):
        paint(plant, scene_graph, instance, shown.color)
    draw_ground(meshcat)
    meshcat.SetCameraPose([1.2, -1.65, 0.9], [0.0, 0.0, 0.1])
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
    return builder.Build(), plant, instances


def _positions(rollout: Rollout, lane: float) -> Array:
    """Returns a robot's positions q (n + 1, 19), moved sideways into its lane (m)."""
    positions = rollout["state"][:, : quadruped.N_POSITIONS].copy()
    positions[:, quadruped.POSITION] += [0.0, lane, 0.0]
    return positions


def _with_legend(page: str, robots: Sequence[ReplayedRobot]) -> str:
    """Adds to Meshcat's page, which shows no text, whose colour is whose."""
    lines = "".join(
        f'<div><span style="color: {shown.color}">■</span> {escape(shown.caption)}</div>'
        for shown in robots
    )
    style = (
        "position: fixed; left: 12px; top: 12px; padding: 8px 12px; background: white; "
        "border-radius: 6px; font: 15px/1.5 sans-serif; color: black"
    )
    head, end, tail = page.rpartition("</body>")
    return f'{head}<div id="legend" style="{style}">{lines}</div>\n{end}{tail}'
