"""Drawings of reward machines as Graphviz and Mermaid text.

Names are a person's own words, so they are quoted as each language asks.
"""

import re
from typing import NamedTuple

from glassgait.models.task.gait import Gait, Transition
from glassgait.models.task.palette import state_colors


class _Arrow(NamedTuple):
    """An edge: the state that it leaves, the one that it enters, its formula and what else it asks
    for."""

    source: str
    target: str
    formula: str
    conditions: str


class _Graph(NamedTuple):
    """What is drawn of a machine: its states in colours, those at fault in double circles."""

    name: str
    initial: str
    colors: dict[str, str]
    faults: tuple[str, ...]
    arrows: list[_Arrow]


def to_graphviz(gait: Gait) -> str:
    """Draws a gait's reward machine in Graphviz's language."""
    graph = _graph(gait)
    lines = [
        f"digraph {_quoted(graph.name)} {{",
        "  rankdir=LR;",
        '  node [shape=circle, style=filled, fontname="Helvetica", fontcolor=white];',
        '  edge [fontname="Helvetica", fontsize=10];',
        # No state has an empty name.
        '  "" [shape=point, fillcolor=black];',
        f'  "" -> {_quoted(graph.initial)};',
    ]
    for state, color in graph.colors.items():
        shape = ", shape=doublecircle" if state in graph.faults else ""
        lines.append(f'  {_quoted(state)} [fillcolor="{color}"{shape}];')
    for source, target, formula, conditions in graph.arrows:
        label = f"{formula}\\n{conditions}"
        lines.append(f'  {_quoted(source)} -> {_quoted(target)} [label="{label}"];')
    return "\n".join([*lines, "}"]) + "\n"


def to_mermaid(gait: Gait) -> str:
    """Draws a gait's reward machine in Mermaid's language."""
    graph = _graph(gait)
    # Some names, such as "end", are words of the language, so that states go by their numbers.
    ids = {state: f"s{i}" for i, state in enumerate(graph.colors)}
    lines = ["stateDiagram-v2", "  direction LR"]
    lines += [f'  state "{_coded(state)}" as {ids[state]}' for state in graph.colors]
    lines.append(f"  [*] --> {ids[graph.initial]}")
    for source, target, *texts in graph.arrows:
        label = ", ".join(filter(None, texts))
        lines.append(f"  {ids[source]} --> {ids[target]}: {label}")
    return "\n".join(lines) + "\n"


def _graph(gait: Gait) -> _Graph:
    arrows = [
        _Arrow(edge.source, edge.target, edge.when.text, _conditions(gait, edge))
        for edge in gait.transitions
    ]
    colors = dict(zip(gait.states, state_colors(gait), strict=True))
    return _Graph(gait.name, gait.initial, colors, gait.faults, arrows)


def _quoted(name: str) -> str:
    """Quotes a name for Graphviz, which reads escapes and HTML's entities in it."""
    escaped = name.replace("&", "&amp;").replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _coded(name: str) -> str:
    """Writes a name for Mermaid: all but letters, digits and spaces by their codes."""
    return re.sub(r"[^\w ]", lambda found: f"#{ord(found[0])};", name)


def _conditions(gait: Gait, edge: Transition) -> str:
    parts = []
    if edge.dwell > 0:
        share = "" if edge.dwell == 1 else f"{edge.dwell:g} × "
        parts.append(f"after {share}dwell")
    if any(edge.when.swing_feet):
        parts.append(f"swing feet ≥ {gait.clearance:g} m")
    if edge.grace > 0:
        parts.append(f"from step {edge.grace}")
    return ", ".join(parts)
