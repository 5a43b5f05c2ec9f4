"""Draws the pictures of the README and of the pages.

`python -m glassgait.studies.pictures.draw` does it. The loop is drawn by Graphviz's `dot` from the
diagram's own description; robots need EGL.
"""

import io
import re
import subprocess
from itertools import zip_longest
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from glassgait.diagrams.camera import Camera
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert, shipped_experts
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.distillation.students.baselines import untrained_student
from glassgait.studies.training.figures import ablation_curves, learning_curves
from glassgait.studies.view.stills import gait_strip

FOLDER = Path(__file__).parent
ABLATION_DIRECTORY = EXPERT_DIRECTORY / "ablation"

ABLATIONS = {
    "curriculum": {
        "with the curriculum": "bound_with_curriculum.csv",
        "without (paper)": "bound_without_curriculum.csv",
    },
    "mirror_and_latency": {
        "both": "trot_short.csv",
        "without the mirror": "trot_without_mirror.csv",
        "without latency": "trot_without_latency.csv",
    },
}
"""Runs that differ in an ingredient, by picture and by the name of their line."""

FRAME_STEPS = 2
"""Control steps between two frames: 25 frames a second."""
FILMED_STEPS = 96
SETTLING_STEPS = 100
COMMAND = FixedCommand(speed=0.4, dwell=8)


def draw_all() -> None:
    """Draws every picture."""
    say("drawing the loop")
    write_atomically(FOLDER / "locomotion.svg", loop_svg(load_gait("trot")))
    for name in shipped_experts():
        say(f"filming the {name}")
        gait = load_gait(name)
        rollout = expert_rollout(gait, COMMAND, SETTLING_STEPS + FILMED_STEPS)
        save_figure(
            gait_strip(load_robot(), rollout, gait), FOLDER / f"{name}_gait", extensions=("png",)
        )
        camera = Camera(load_robot(), 480, 300)
        frames = [camera.take(x) for x in rollout["state"][SETTLING_STEPS::FRAME_STEPS]]
        write_atomically(FOLDER / f"{name}.gif", gif(frames))
    say("drawing the learning curves")
    curves = {name: pd.read_csv(EXPERT_DIRECTORY / f"{name}.csv") for name in shipped_experts()}
    save_figure(learning_curves(curves), FOLDER / "learning_curves", extensions=("png",))
    for name, lines in ABLATIONS.items():
        curves = {label: pd.read_csv(ABLATION_DIRECTORY / file) for label, file in lines.items()}
        save_figure(ablation_curves(curves), FOLDER / name, extensions=("png",))


def expert_rollout(gait: Gait, command: FixedCommand, n_steps: int) -> Rollout:
    """Rolls the expert out under one command."""
    scenario = Scenario(command=command, sensor_noise=0.0)
    diagram = MakeLocomotion(gait, scenario, policy=load_expert(gait.name))
    return record(make_simulator(diagram), n_steps)


def loop_svg(gait: Gait) -> str:
    """Draws the locomotion diagram, with expert and student, as SVG."""
    expert = load_expert(gait.name)
    student = untrained_student(expert)
    scenario = Scenario(command=COMMAND, sensor_noise=0.0)
    diagram = MakeLocomotion(
        gait, scenario, policy=AlternatingController(expert, student, period=4)
    )
    dot = _without_exports(diagram.GetGraphvizString(max_depth=1))
    arguments = ["dot", "-Tsvg", "-Gnodesep=0.12", "-Granksep=0.35", "-Nfontname=Helvetica"]
    drawn = subprocess.run(arguments, input=dot, text=True, check=True, capture_output=True)
    return re.sub(r"<!--.*?-->\n", "", drawn.stdout, flags=re.DOTALL)


def _without_exports(dot: str) -> str:
    """Leaves out exported outputs, the plant's unused ports, and module names."""
    dot = re.sub(r"^.*\[color=green\];\n", "", dot, flags=re.MULTILINE)
    dot = re.sub(r"subgraph clusters\d+out \{.*?^\}\n", "", dot, flags=re.DOTALL | re.MULTILINE)
    dot = re.sub(r"glassgait\.systems\.\w+\.", "", dot)
    return _without_unused_ports(dot, "MultibodyPlant")


def _without_unused_ports(dot: str, system: str) -> str:
    title = dot.index(f"<B>{system}</B>")
    node = re.findall(r"^(s\d+) \[", dot[:title], flags=re.MULTILINE)[-1]
    used = set(re.findall(rf"\b{node}:([uy]\d+)", dot))
    start = dot.index("</TD></TR>\n", title) + len("</TD></TR>\n")
    stop = dot.index("</TABLE>", start)
    cells = re.findall(r'(<TD PORT="(([uy])\d+)".*?</TD>)', dot[start:stop])
    kept = {
        side: [cell for cell, port, of in cells if of == side and port in used] for side in "uy"
    }
    rows = zip_longest(kept["u"], kept["y"], fillvalue="<TD></TD>")
    table = "".join(f"<TR>{left}{right}</TR>\n" for left, right in rows)
    return dot[:start] + table + dot[stop:]


def gif(frames: list[np.ndarray]) -> bytes:
    """Encodes frames (height, width, 3) as an endless GIF."""
    palette = Image.fromarray(frames[0]).quantize(96)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    buffer = io.BytesIO()
    images[0].save(
        buffer, "GIF", save_all=True, append_images=images[1:], duration=40, loop=0, optimize=True
    )
    return buffer.getvalue()


if __name__ == "__main__":
    draw_all()
