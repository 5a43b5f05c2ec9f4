"""Drawings of a reward machine: Graphviz and Mermaid text.

Names are a person's own words, so they are quoted as each language asks.
"""

import re

from glassgait.models.task.gait import Gait, Transition
from glassgait.models.task.palette import state_colors


def to_graphviz(gait: Gait) -> str:
    """Draws the reward machine in Graphviz's language."""
    lines = [
        f"digraph {_quoted(gait.name)} {{",
        "  rankdir=LR;",
        '  node [shape=circle, style=filled, fontname="Helvetica", fontcolor=white];',
        '  edge [fontname="Helvetica", fontsize=10];',
        # No state has an empty name.
        '  "" [shape=point, fillcolor=black];',
        f'  "" -> {_quoted(gait.initial)};',
    ]
    for state, color in zip(gait.states, state_colors(gait), strict=True):
        shape = ", shape=doublecircle" if state in gait.faults else ""
        lines.append(f'  {_quoted(state)} [fillcolor="{color}"{shape}];')
    for edge in gait.transitions:
        label = f"{edge.when.text}\\n{_conditions(gait, edge)}"
        arrow = f"{_quoted(edge.source)} -> {_quoted(edge.target)}"
        lines.append(f'  {arrow} [label="{label}"];')
    return "\n".join([*lines, "}"]) + "\n"


def to_mermaid(gait: Gait) -> str:
    """Draws the reward machine in Mermaid's language."""
    # Some names, such as "end", are words of the language, so that states go by their numbers.
    ids = {state: f"s{i}" for i, state in enumerate(gait.states)}
    lines = ["stateDiagram-v2", "  direction LR"]
    lines += [f'  state "{_coded(state)}" as {ids[state]}' for state in gait.states]
    lines.append(f"  [*] --> {ids[gait.initial]}")
    for edge in gait.transitions:
        label = f"{edge.when.text}, {_conditions(gait, edge)}"
        lines.append(f"  {ids[edge.source]} --> {ids[edge.target]}: {label}")
    return "\n".join(lines) + "\n"


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
