"""Drawings of reward machines and colours of their states."""

import re
from dataclasses import replace

import pytest

from glassgait.models.task.drawing import FAULT_COLORS, state_colors, to_mermaid
from glassgait.models.task.gait import gait_names, load_gait

HOSTILE = ('say "x"', "back\\", "a; b", "a -> b", "end", "[*]", "a:b", "%% x", "&quot;", "Füße")


@pytest.mark.parametrize("name", gait_names())
def test_every_state_and_transition_is_drawn(name):
    gait = load_gait(name)
    drawing = to_mermaid(gait)
    for edge in gait.transitions:
        source, target = (gait.states.index(state) for state in (edge.source, edge.target))
        assert f"s{source} --> s{target}: {edge.when.text}," in drawing
    for i, state in enumerate(gait.states):
        assert f'state "{state}" as s{i}\n' in drawing
    assert f"[*] --> s{gait.states.index(gait.initial)}\n" in drawing


@pytest.mark.parametrize("name", HOSTILE)
def test_names_never_end_a_statement(name):
    trot = load_gait("trot")
    other = {"q0": "q0", "q1": name}
    edges = [
        replace(edge, source=other[edge.source], target=other[edge.target])
        for edge in trot.transitions
    ]
    gait = replace(trot, states=("q0", name), transitions=tuple(edges))
    found = re.search(r'^  state "((?:[\w ]|#\d+;)*)" as s1$', to_mermaid(gait), flags=re.MULTILINE)
    assert found
    assert re.sub(r"#(\d+);", lambda code: chr(int(code[1])), found[1]) == name


@pytest.mark.parametrize("name", gait_names())
def test_states_differ_in_colour_and_faults_are_grey(name):
    gait = load_gait(name)
    colors = dict(zip(gait.states, state_colors(gait), strict=True))
    assert len(set(colors.values())) == gait.n_states
    assert {state for state, color in colors.items() if color in FAULT_COLORS} == {*gait.faults}
