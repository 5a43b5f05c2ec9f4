"""Meshcat views of a robot and its ghost, and replays in HTML."""

import logging
from pathlib import Path

import numpy as np
from pydrake.geometry import (
    Box,
    IllustrationProperties,
    Meshcat,
    MeshcatParams,
    MeshcatVisualizer,
    Rgba,
    Role,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from glassgait.diagrams.rollout import Rollout, set_plant_state
from glassgait.diagrams.station import add_robot, ground_reach
from glassgait.models.arrays import Array
from glassgait.models.files import write_atomically
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.models.task.ground import Ground
from glassgait.models.task.terrain import PLANE, Terrain, grid_of
from glassgait.systems.gait_display import PAVEMENT_PATH, TILE, WORLD_PATH, GaitDisplay

BOXES_PATH = f"{WORLD_PATH}/terrain"  # Meshcat path of ground boxes

SHADES = ((0.62, 0.64, 0.66), (0.56, 0.58, 0.60))  # colours of ground boxes
PATCH_SHADE = (0.55, 0.66, 0.78)  # colour of boxes with the patches' friction

GHOST_PATH, GHOST_COLOR = f"{WORLD_PATH}/visualizer/ghost", Rgba(0.54, 0.58, 0.64, 0.4)

LANE = 0.6  # distance of the ghost to the robot's left (m)


def open_meshcat(port: int | None = None) -> Meshcat:
    """Starts a Meshcat server that only this machine can reach."""
    log = logging.getLogger("drake")
    level = log.level
    # Hide Drake's announcement of the server.
    log.setLevel(logging.WARNING)
    try:
        return Meshcat(MeshcatParams(host="localhost", port=port, show_stats_plot=False))
    finally:
        log.setLevel(level)


def draw_ground(meshcat: Meshcat, terrain: Terrain = PLANE) -> None:
    """Draws the boxes of a terrain at `BOXES_PATH`, or a plane's pavement at `PAVEMENT_PATH`."""
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", 0.9)
    meshcat.SetProperty("/Background/<object>", "top_color", [0.93, 0.95, 0.97])
    meshcat.SetProperty("/Background/<object>", "bottom_color", [0.80, 0.83, 0.86])
    if not terrain.is_plane:
        _draw_boxes(meshcat, terrain)
        return
    # Draw tiles, since a robot's speed is not visible on a uniform plane.
    ground = f"{PAVEMENT_PATH}/ground"
    meshcat.SetObject(ground, Box(30.0, 30.0, 0.02), Rgba(0.62, 0.64, 0.66, 1.0))
    meshcat.SetTransform(ground, RigidTransform([0.0, 0.0, -0.0125]))
    lines = int(15.0 / TILE)
    for i in range(-lines, lines + 1):
        for name, box, place in (
            (f"x{i}", Box(30.0, 0.006, 0.002), [0.0, i * TILE, -0.002]),
            (f"y{i}", Box(0.006, 30.0, 0.002), [i * TILE, 0.0, -0.002]),
        ):
            meshcat.SetObject(f"{PAVEMENT_PATH}/{name}", box, Rgba(0.5, 0.52, 0.54, 1.0))
            meshcat.SetTransform(f"{PAVEMENT_PATH}/{name}", RigidTransform(place))


def _draw_boxes(meshcat: Meshcat, terrain: Terrain) -> None:
    grid = grid_of(terrain)
    for i, box in enumerate(terrain.boxes(ground_reach(terrain))):
        # Shade boxes like a chessboard, so that their edges are visible.
        number = int(np.floor((box.centre[:2] - grid.origin) / grid.cell).sum())
        path = f"{BOXES_PATH}/{i}"
        shade = PATCH_SHADE if box.is_patch else SHADES[number % 2]
        meshcat.SetObject(path, Box(*box.size), Rgba(*shade, 1.0))
        meshcat.SetTransform(path, RigidTransform(RotationMatrix(box.rotation), box.centre))


def save_replay(
    diagram: Diagram, meshcat: Meshcat, rollout: Rollout, path: Path, *, repetitions: int = 1
) -> None:
    """Writes an animation of all recorded control steps as an HTML page.

    The diagram comes from `MakeLocomotion` with this Meshcat. The rollout's first instant is the
    replay's time 0. A browser without WebGL shows a note.
    """
    context = diagram.CreateDefaultContext()
    display = diagram.GetSubsystemByName("gait_display")
    display_context = display.GetMyMutableContextFromRoot(context)
    meshcat.DeleteRecording()
    meshcat.StartRecording(
        frames_per_second=1.0 / CONTROL_PERIOD, set_visualizations_while_recording=False
    )
    samples = zip(rollout.time, rollout["state"], rollout["rm_state"], strict=True)
    for time, state, rm_state in samples:
        context.SetTime(time - rollout.time[0])
        set_plant_state(diagram, context, state)
        # Fix the recorded RM state, since the reward machine's memory is not recorded.
        display.GetInputPort("rm_state").FixValue(display_context, rm_state)
        diagram.ForcedPublish(context)

    # Write a page that contains all scripts and pictures. An enclosing page seeks by the message
    # `{replay: seconds}`.
    meshcat.StopRecording()
    meshcat.get_mutable_recording().set_repetitions(repetitions)
    meshcat.PublishRecording()
    page = meshcat.StaticHtml()
    for old, new in _REPLACEMENTS:
        page = page.replace(old, new, 1)
    start = page.rindex("</body>")
    write_atomically(path, f"{page[:start]}{webgl_note()}{_REPLAY_SCRIPT}{page[start:]}")


def webgl_note(otherwise: str = "") -> str:
    """Returns HTML with a note for browsers without WebGL; others run the script `otherwise`."""
    return _NOTE.format(otherwise=otherwise)


_NOTE = """<p id="note" style="display: none; position: fixed; inset: 0; z-index: 9; margin: 0;
 padding: 1rem; background: #eef2f6; color: #1b1f24; font: 15px/1.4 sans-serif">The animation needs
WebGL, which is off or missing in this browser.</p>
<script>
if (document.createElement("canvas").getContext("webgl2")) {{ {otherwise} }}
else document.getElementById("note").style.display = "block";
</script>
"""


_REPLACEMENTS = (
    ("<html>", '<html lang="en">'),
    ("<title>", '<meta name="viewport" content="width=device-width, initial-scale=1"><title>'),
    ("Drake MeshCat", "Replay"),
)

_REPLAY_SCRIPT = """<script>
window.addEventListener("message", event => {
  const seconds = event.data && event.data.replay;
  if (typeof seconds !== "number" || typeof viewer === "undefined" || !viewer.animator) return;
  viewer.animator.pause();
  viewer.animator.seek(seconds);
});
if (window.parent !== window) {
  // Meshcat starts to play when it has loaded, without an event.
  const announce = () => window.parent.postMessage({replay: "ready"}, "*");
  for (const wait of [0, 400, 1500, 4000]) setTimeout(announce, wait);
}
else if (matchMedia("(prefers-reduced-motion: reduce)").matches)
  for (const wait of [0, 400, 1500]) setTimeout(() => viewer.animator?.pause(), wait);
// Label Meshcat's controls, which appear as its scene loads.
const label = input => input.ariaLabel = (input.closest("li.cr") ?? input.closest("div.dg"))
  .querySelector(".property-name, .title").textContent;
for (const wait of [0, 400, 1500, 4000])
  setTimeout(() => document.querySelectorAll(".dg input, .dg select").forEach(label), wait);
</script>
"""


class LiveDisplay:
    """Displays a robot with its contacts, and its ghost beside it, live in Meshcat."""

    def __init__(
        self, robot: Robot, gait: Gait, meshcat: Meshcat, *, terrain: Terrain = PLANE
    ) -> None:
        """Replaces everything in the Meshcat."""
        self._meshcat, self._ground = meshcat, Ground([terrain])
        meshcat.Delete()

        # The plant holds robot and ghost, and is never simulated.
        builder = DiagramBuilder()
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        self._instances = [
            add_robot(Parser(self._plant, name), robot) for name in ("robot", "ghost")
        ]
        self._plant.Finalize()
        _paint(self._plant, scene_graph, self._instances[1])

        # Set up the scene.
        draw_ground(meshcat, terrain)
        meshcat.SetCameraPose([0.85, -1.0, 0.55], [0.0, 0.2, 0.1])
        MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat)
        marks = builder.AddNamedSystem("gait_display", GaitDisplay(robot, gait, meshcat))
        for name in ("state", "rm_state", "foot_contact"):
            builder.ExportInput(marks.GetInputPort(name), name)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        meshcat.SetTransform(GHOST_PATH, RigidTransform([0.0, LANE, 0.0]))

    def show(
        self, state: Array, *, rm_state: Array, foot_contact: Array, ghost: Array | None = None
    ) -> None:
        """Draws the RM state (n_states, one-hot), contacts (4), and x (37) of robot and ghost."""
        # The modelled ground is its middle period.
        away = self._ground.periods(state)
        ghost_state = kinematics.moved_by(state if ghost is None else ghost, -away)
        state = kinematics.moved_by(state, -away)

        # The marks read input ports; the plant's positions set the poses of both robots.
        inputs = {"state": state, "rm_state": rm_state, "foot_contact": foot_contact}
        for name, value in inputs.items():
            self._diagram.GetInputPort(name).FixValue(self._context, value)
        for instance, pose in zip(self._instances, (state, ghost_state), strict=True):
            self._plant.SetPositions(self._plant_context, instance, pose[: quadruped.N_POSITIONS])
        self._diagram.ForcedPublish(self._context)
        self._meshcat.SetProperty(GHOST_PATH, "visible", ghost is not None)


def _paint(plant: MultibodyPlant, scene_graph: SceneGraph, ghost: ModelInstanceIndex) -> None:
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    for body in plant.GetBodyIndices(ghost):
        frame = plant.GetBodyFrameIdOrThrow(body)
        for geometry in inspector.GetGeometries(frame, Role.kIllustration):
            painted = IllustrationProperties(inspector.GetIllustrationProperties(geometry))
            painted.UpdateProperty("phong", "diffuse", GHOST_COLOR)
            # Remove and assign the role, since Drake warns if a call replaces it.
            scene_graph.RemoveRole(source, geometry, Role.kIllustration)
            scene_graph.AssignRole(source, geometry, painted)
