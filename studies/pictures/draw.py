"""Draws the pictures of the documentation from the policies and records that ship.

`python -m glassgait.studies.pictures.draw` draws all of them; names such as `worlds.png` select
some. The diagram needs Graphviz's `dot`. Screenshots and films are made by hand.
"""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.scenario import NOMINAL_SCENARIO, Scenario
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert, shipped_experts
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import say
from glassgait.studies.common.figures import save_figure, styled, subplots
from glassgait.studies.distillation.linear import untrained_student
from glassgait.studies.evaluation.figures import fall_map
from glassgait.studies.training.figures import learning_curves
from glassgait.studies.training.record import trainings

FOLDER = Path(__file__).parent

# Falls of 26 robots in 10 s: of every shipped policy of the A1; of the Go2's trot and networks of
# other projects.
FALLS = {"worlds.png": FOLDER / "falls.csv", "worlds_go2.png": FOLDER / "falls_go2.csv"}

SCENARIO = Scenario(command=FixedCommand(speed=0.4, dwell=8), sensor_noise=0.0)


def draw(names: Sequence[str] = ()) -> None:
    """Draws the named pictures, by default all."""
    known = ["locomotion.svg", "learning_curves.png", "policies.png", *FALLS]
    for name in names or known:
        say(f"drawing {name}")
        path = FOLDER / name
        if name == "locomotion.svg":
            write_atomically(path, diagram_svg())
        elif name == "learning_curves.png":
            curves = {gait: _learning_curve(gait) for gait in shipped_experts()}
            save_figure(learning_curves(curves), path.with_suffix(""), ("png",))
        elif name == "policies.png":
            save_figure(policies_figure(), path.with_suffix(""), ("png",))
        elif name in FALLS:
            save_figure(fall_map(fall_tables(FALLS[name])), path.with_suffix(""), ("png",))


def _learning_curve(name: str) -> pd.DataFrame:
    """Concatenates the curves of an expert's trainings, with control steps counted in total."""
    curves, steps = [], 0
    for record_path in trainings(EXPERT_DIRECTORY / f"{name}.yaml"):
        curve = pd.read_csv(record_path.with_suffix(".csv"))
        curves.append(curve.assign(control_steps=curve["control_steps"] + steps))
        steps = curves[-1]["control_steps"].iloc[-1]
    return pd.concat(curves, ignore_index=True)


@styled
def policies_figure() -> Figure:
    """Draws the operations per action of each policy of the trot, with the falls of 130 robots."""
    table = pd.read_csv(FOLDER / "policies.csv")[::-1]
    figure, axes = subplots(figsize=(4.0, 4.2))
    operations, falls = table["operations per action"], table["falls"]
    bars = axes.barh(table["policy"], operations, color=np.where(falls, "#D55E00", "#0072B2"))
    labels = [f"{n:,} ({fell} fell)" for n, fell in zip(operations, falls, strict=True)]
    axes.bar_label(bars, labels, padding=3, fontsize=7)
    axes.set(title="Trot: 130 robots of each policy", xscale="log", xlim=(10, 4e5))
    axes.set_xticks(ticks := [10, 100, 1000, 10_000], [f"{tick:,}" for tick in ticks])
    axes.set_xlabel("operations per action")
    axes.grid(axis="y", visible=False)
    return figure


def fall_tables(path: Path) -> dict[str, pd.DataFrame]:
    """Reads the falls of each gait, in the form of `fall_table`."""
    falls = pd.read_csv(path)
    falls = falls.assign(world=falls["scenario"], robots=26, fall_rate=falls["falls"] / 26)
    falls.loc[falls["scenario"].str.startswith("nominal"), "scenario"] = NOMINAL_SCENARIO
    return {str(gait): table for gait, table in falls.groupby("gait", sort=False)}


def diagram_svg() -> str:
    """Draws the locomotion diagram, with expert and student, as SVG."""
    expert = load_expert("trot")
    policy = Controller(expert, untrained_student(expert), period=4)
    diagram = MakeLocomotion(load_gait("trot"), SCENARIO, policy=policy)
    dot = diagram.GetGraphvizString(max_depth=1)
    # Remove exported outputs and module names, which hide the loop.
    dot = re.sub(r"^.*\[color=green\];\n", "", dot, flags=re.MULTILINE)
    dot = re.sub(r"subgraph clusters\d+out \{.*?^\}\n", "", dot, flags=re.DOTALL | re.MULTILINE)
    dot = re.sub(r"glassgait\.systems\.\w+\.", "", dot)
    arguments = ["dot", "-Tsvg", "-Gnodesep=0.12", "-Granksep=0.35", "-Nfontname=Helvetica"]
    drawn = subprocess.run(arguments, input=dot, text=True, check=True, capture_output=True)
    return re.sub(r"<!--.*?-->\n", "", drawn.stdout, flags=re.DOTALL)


if __name__ == "__main__":
    draw(sys.argv[1:])
