"""Draws the pictures of the README and of the pages, and records what they were drawn from.

`python -m glassgait.studies.pictures.draw` draws all, and with names, such as `blocks.svg`, those
alone. The loop is drawn by Graphviz's `dot` from the diagram's own description; robots need EGL.
"""

import io
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from glassgait.models.policies.library import (
    EXPERT_DIRECTORY,
    STUDENT_DIRECTORY,
    load_expert,
    shipped_expert,
    shipped_experts,
)
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import GAIT_DIRECTORY, Gait, load_gait
from glassgait.studies.common.console import say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.distillation.pareto_figure import pareto_figure
from glassgait.studies.distillation.students.baselines import untrained_student
from glassgait.studies.evaluation.worlds_figures import fall_overview
from glassgait.studies.pictures.age import FOLDER, ROOT, digest_of_text, digests, note
from glassgait.studies.pictures.blocks import blocks_svg
from glassgait.studies.pictures.falls import fall_lines, falls_on
from glassgait.studies.training.figures import ablation_curves, learning_curves
from glassgait.studies.training.record import trainings
from glassgait.studies.view.stills import gait_strip

FALLS_PAGE = ROOT / "models" / "README.md"
"""The page whose table of falls the map shows."""

FRONTS = STUDENT_DIRECTORY / "fronts.csv"
"""Pages of growing size of four gaits: what they keep of the return, falls, fit, stability."""

ABLATION_DIRECTORY = EXPERT_DIRECTORY / "ablation"

ABLATIONS = {
    "curriculum.png": {
        "with the curriculum": "bound_with_curriculum.csv",
        "without (paper)": "bound_without_curriculum.csv",
    },
    "mirror_and_latency.png": {
        "both": "trot_short.csv",
        "without the mirror": "trot_without_mirror.csv",
        "without latency": "trot_without_latency.csv",
    },
}
"""Runs that differ in an ingredient, by picture and by the name of their line."""

STRIPS = ("trot", "three_one", "half_bound")
"""Gaits of which pages show stills: one that all know, and two that are the project's own."""

FRAME_STEPS = 2
"""Control steps between two frames: 25 frames a second."""
FILMED_STEPS = 96
SETTLING_STEPS = 100
COMMAND = FixedCommand(speed=0.4, dwell=8)

COMMAND_LINE = "python -m glassgait.studies.pictures.draw"


@dataclass(frozen=True)
class Picture:
    """A picture that is drawn from what ships.

    Attributes:
        draw: Draws it.
        inputs: Returns the digests of what it is drawn from, by their names.
    """

    draw: Callable[[Path], None]
    inputs: Callable[[], dict[str, str]]


def pictures() -> dict[str, Picture]:
    """Returns the pictures that are drawn here, by the names of their files."""
    trot = load_gait("trot")
    whole = {
        "blocks.svg": Picture(
            lambda path: write_atomically(path, blocks_svg()),
            lambda: {"drawing": digest_of_text(blocks_svg())},
        ),
        "locomotion.svg": Picture(
            lambda path: write_atomically(path, loop_svg(trot)),
            lambda: {"diagram": digest_of_text(loop_dot(trot))},
        ),
        "learning_curves.png": Picture(_draw_learning_curves, _learning_curves),
        "fronts.png": Picture(_draw_fronts, lambda: digests(FRONTS)),
        "worlds.png": Picture(
            lambda path: save_figure(
                fall_overview(falls_on(FALLS_PAGE.read_text())), path.with_suffix(""), ("png",)
            ),
            lambda: {"table": digest_of_text("\n".join(fall_lines(FALLS_PAGE.read_text())))},
        ),
    }
    for name in shipped_experts():
        whole[f"{name}.gif"] = Picture(_Filmed(name).draw_film, _Filmed(name).inputs)
    for name in STRIPS:
        whole[f"{name}_gait.png"] = Picture(_Filmed(name).draw_strip, _Filmed(name).inputs)
    for name, lines in ABLATIONS.items():
        whole[name] = Picture(_Ablation(lines).draw, _Ablation(lines).inputs)
    return whole


def draw(names: Sequence[str] = ()) -> None:
    """Draws pictures, by default all, and records what each was drawn from."""
    known = pictures()
    for name in names or known:
        say(f"drawing {name}")
        known[name].draw(FOLDER / name)
        note(name, f"{COMMAND_LINE} {name}", known[name].inputs())


def _curves(name: str) -> list[Path]:
    """Lists the learning curves of a gait's expert, that of its first training first."""
    records = trainings(EXPERT_DIRECTORY / f"{name}.yaml")
    return [record.with_suffix(".csv") for record in records]


def _learning_curves() -> dict[str, str]:
    return digests(*(path for name in shipped_experts() for path in _curves(name)))


def _draw_learning_curves(path: Path) -> None:
    curves = {name: _joined(_curves(name)) for name in shipped_experts()}
    save_figure(learning_curves(curves), path.with_suffix(""), extensions=("png",))


def _joined(paths: Sequence[Path]) -> pd.DataFrame:
    """Returns the curves of trainings that follow each other as one, their steps counted on."""
    curves, steps = [], 0
    for path in paths:
        curve = pd.read_csv(path)
        curves.append(curve.assign(control_steps=curve["control_steps"] + steps))
        steps = curves[-1]["control_steps"].iloc[-1]
    return pd.concat(curves, ignore_index=True)


def _draw_fronts(path: Path) -> None:
    fronts = pd.read_csv(FRONTS).groupby("gait", sort=False)
    figure = pareto_figure({str(gait).capitalize(): own for gait, own in fronts})
    save_figure(figure, path.with_suffix(""), extensions=("png",))


@dataclass(frozen=True)
class _Ablation:
    """Runs that differ in an ingredient: their files, by the name of their line."""

    lines: dict[str, str]

    def inputs(self) -> dict[str, str]:
        return digests(*(ABLATION_DIRECTORY / file for file in self.lines.values()))

    def draw(self, path: Path) -> None:
        curves = {
            label: pd.read_csv(ABLATION_DIRECTORY / file) for label, file in self.lines.items()
        }
        save_figure(ablation_curves(curves), path.with_suffix(""), extensions=("png",))


@dataclass(frozen=True)
class _Filmed:
    """A gait, as its expert goes."""

    name: str

    def inputs(self) -> dict[str, str]:
        robot = load_robot()
        return digests(
            shipped_expert(self.name),
            GAIT_DIRECTORY / f"{self.name}.yaml",
            Path(robot.path),
            robot.urdf_path,
        )

    def draw_strip(self, path: Path) -> None:
        gait = load_gait(self.name)
        figure = gait_strip(load_robot(), self._rollout(), gait)
        save_figure(figure, path.with_suffix(""), extensions=("png",))

    def draw_film(self, path: Path) -> None:
        camera = Camera(load_robot(), 480, 300)
        states = self._rollout()["state"][SETTLING_STEPS::FRAME_STEPS]
        write_atomically(path, gif([camera.take(state) for state in states]))

    def _rollout(self) -> Rollout:
        return expert_rollout(load_gait(self.name), COMMAND, SETTLING_STEPS + FILMED_STEPS)


def expert_rollout(gait: Gait, command: FixedCommand, n_steps: int) -> Rollout:
    """Rolls the expert out under one command."""
    scenario = Scenario(command=command, sensor_noise=0.0)
    diagram = MakeLocomotion(gait, scenario, policy=load_expert(gait.name))
    return record(make_simulator(diagram), n_steps)


def loop_svg(gait: Gait) -> str:
    """Draws the locomotion diagram, with expert and student, as SVG."""
    arguments = ["dot", "-Tsvg", "-Gnodesep=0.12", "-Granksep=0.35", "-Nfontname=Helvetica"]
    dot = loop_dot(gait)
    drawn = subprocess.run(arguments, input=dot, text=True, check=True, capture_output=True)
    return re.sub(r"<!--.*?-->\n", "", drawn.stdout, flags=re.DOTALL)


def loop_dot(gait: Gait) -> str:
    """Describes the locomotion diagram, with expert and student, in Graphviz's language."""
    expert = load_expert(gait.name)
    student = untrained_student(expert)
    scenario = Scenario(command=COMMAND, sensor_noise=0.0)
    diagram = MakeLocomotion(
        gait, scenario, policy=AlternatingController(expert, student, period=4)
    )
    return _numbered_anew(_without_exports(diagram.GetGraphvizString(max_depth=1)))


def _numbered_anew(dot: str) -> str:
    """Counts systems from 0 on, and sorts edges: Drake counts all of a process, and sorts none."""
    numbers: dict[str, int] = {}
    counted = re.sub(
        r"\b(_|s|clusters?)(\d+)",
        lambda found: f"{found[1]}{numbers.setdefault(found[2], len(numbers))}",
        dot,
    )
    lines = counted.splitlines(keepends=True)
    edges = iter(sorted(line for line in lines if " -> " in line))
    return "".join(next(edges) if " -> " in line else line for line in lines)


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
    draw(sys.argv[1:])
