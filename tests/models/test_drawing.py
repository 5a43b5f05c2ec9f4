"""Drawings of reward machines."""

import shutil
import subprocess

import pytest

from models.task.drawing import to_graphviz, to_mermaid
from models.task.gait import gait_names, load_gait


@pytest.mark.parametrize("name", gait_names())
def test_every_state_and_transition_is_drawn(name):
    gait = load_gait(name)
    for drawing, arrow in ((to_graphviz(gait), '"{}" -> "{}"'), (to_mermaid(gait), "{} --> {}:")):
        for edge in gait.transitions:
            assert arrow.format(edge.source, edge.target) in drawing
            assert edge.when.text in drawing


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_graphviz_can_draw_it():
    text = to_graphviz(load_gait("half_bound"))
    drawn = subprocess.run(
        ["dot", "-Tsvg"], input=text, text=True, check=True, capture_output=True
    ).stdout
    assert "<svg" in drawn
    assert all(f">{state}<" in drawn for state in load_gait("half_bound").states)
