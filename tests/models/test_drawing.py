"""Drawings of reward machines and colours of their states."""

import pytest

from glassgait.models.task.drawing import FAULT_COLORS, state_colors, to_text
from glassgait.models.task.gait import gait_names, load_gait


@pytest.mark.parametrize("name", gait_names())
def test_every_state_and_transition_is_drawn(name):
    gait, edges, state = load_gait(name), set(), ""
    for line in to_text(gait).splitlines():
        if line.startswith("  └─ "):
            edges.add((state, line.split(", ")[0].removeprefix("  └─ "), line.split(" → ")[1]))
        else:
            state = line.split(", ")[0]
    assert edges == {(edge.source, edge.when.text, edge.target) for edge in gait.transitions}


@pytest.mark.parametrize("name", gait_names())
def test_states_differ_in_colour_and_faults_are_grey(name):
    gait = load_gait(name)
    colors = dict(zip(gait.states, state_colors(gait), strict=True))
    assert len(set(colors.values())) == gait.n_states
    assert {state for state, color in colors.items() if color in FAULT_COLORS} == {*gait.faults}
