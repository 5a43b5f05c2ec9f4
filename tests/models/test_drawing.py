"""Drawings of reward machines."""

import html
import re
import shutil
import subprocess
from dataclasses import replace
from itertools import pairwise

import pytest

from glassgait.models.task.drawing import to_graphviz, to_mermaid
from glassgait.models.task.formula import parse_formula
from glassgait.models.task.gait import Gait, Transition, gait_names, load_gait
from glassgait.models.task.palette import FAULT_COLORS, state_colors

pydot = pytest.importorskip("pydot")

HOSTILE = [
    'say "x"', "back\\", '\\"', "a; b", "{a}", "a -> b", "end", "start", "[*]", "s0", "a:b", "%% x",
    "#34;", "&quot;", "<b>", "x]y", "q|r", "node", "Füße", "[bold]", "`x`", "$x$",
]  # fmt: skip


def ring(states: list[str], name: str = "ring") -> Gait:
    stances = ("FL & ~FR", "FR & ~FL")
    edges = tuple(
        Transition(state, states[(i + 1) % len(states)], parse_formula(stances[i % 2]))
        for i, state in enumerate(states)
    )
    return replace(
        load_gait("trot"), name=name, states=tuple(states), initial=states[0], transitions=edges
    )


@pytest.mark.parametrize("name", gait_names())
def test_every_state_and_transition_is_drawn(name):
    gait = load_gait(name)
    graphviz, mermaid = to_graphviz(gait), to_mermaid(gait)
    for edge in gait.transitions:
        source, target = (gait.states.index(state) for state in (edge.source, edge.target))
        assert f'"{edge.source}" -> "{edge.target}" [label="{edge.when.text}' in graphviz
        assert f"s{source} --> s{target}: {edge.when.text}," in mermaid
    for i, state in enumerate(gait.states):
        assert f'state "{state}" as s{i}\n' in mermaid
    assert f"[*] --> s{gait.states.index(gait.initial)}\n" in mermaid


@pytest.mark.parametrize("name", HOSTILE)
def test_graphviz_reads_back_any_name_of_a_gait(name):
    (graph,) = pydot.graph_from_dot_data(to_graphviz(ring(["q0", "q1"], name)))
    assert unquoted(graph.get_name()) == name


def test_graphviz_reads_back_any_names():
    (graph,) = pydot.graph_from_dot_data(to_graphviz(ring(HOSTILE, "trot")))
    assert unquoted(graph.get_name()) == "trot"
    # The last of pydot's nodes are ours; before them stand defaults and the start.
    drawn = [unquoted(node.get_name()) for node in graph.get_nodes()]
    assert drawn[-len(HOSTILE) :] == HOSTILE
    edges = [(unquoted(e.get_source()), unquoted(e.get_destination())) for e in graph.get_edges()]
    assert edges == [("", HOSTILE[0]), *pairwise([*HOSTILE, HOSTILE[0]])]


def test_mermaid_names_are_written_by_codes_and_never_end_a_statement():
    lines = to_mermaid(ring(HOSTILE)).splitlines()
    states = [line for line in lines if line.startswith("  state ")]
    assert len(lines) == 2 + len(HOSTILE) + 1 + len(HOSTILE)
    for i, (line, name) in enumerate(zip(states, HOSTILE, strict=True)):
        found = re.fullmatch(rf'  state "((?:[\w ]|#\d+;)*)" as s{i}', line)
        assert found
        assert re.sub(r"#(\d+);", lambda code: chr(int(code[1])), found[1]) == name


def unquoted(text: str) -> str:
    """Reads a quoted name as Graphviz does: its escapes, then HTML's entities."""
    return html.unescape(re.sub(r"\\(.)", r"\1", text[1:-1]))


@pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
def test_graphviz_can_draw_it(unforgiving):
    text = to_graphviz(unforgiving)
    drawn = subprocess.run(
        ["dot", "-Tsvg"], input=text, text=True, check=True, capture_output=True
    ).stdout
    assert "<svg" in drawn
    assert all(f">{state}<" in drawn for state in unforgiving.states)


@pytest.mark.parametrize("name", gait_names())
def test_states_of_a_gait_differ_in_colour_and_faults_are_grey(name):
    gait = load_gait(name)
    colors = dict(zip(gait.states, state_colors(gait), strict=True))
    assert len(set(colors.values())) == gait.n_states
    assert {state for state, color in colors.items() if color in FAULT_COLORS} == {*gait.faults}
