"""Drawings of a reward machine: Graphviz and Mermaid text."""

from models.task.gait import Gait, Transition
from models.task.palette import STATE_COLORS


def to_graphviz(gait: Gait) -> str:
    """Draws the reward machine in Graphviz's language."""
    lines = [
        f'digraph "{gait.name}" {{',
        "  rankdir=LR;",
        '  node [shape=circle, style=filled, fontname="Helvetica", fontcolor=white];',
        '  edge [fontname="Helvetica", fontsize=10];',
        "  start [shape=point, fillcolor=black];",
        f'  start -> "{gait.initial}";',
    ]
    for i, state in enumerate(gait.states):
        shape = ", shape=doublecircle" if state == gait.sink else ""
        color = STATE_COLORS[i % len(STATE_COLORS)]
        lines.append(f'  "{state}" [fillcolor="{color}"{shape}];')
    for edge in gait.transitions:
        label = f"{edge.when.text}\\n{_conditions(gait, edge)}"
        lines.append(f'  "{edge.source}" -> "{edge.target}" [label="{label}"];')
    return "\n".join([*lines, "}"]) + "\n"


def to_mermaid(gait: Gait) -> str:
    """Draws the reward machine in Mermaid's language."""
    lines = ["stateDiagram-v2", "  direction LR", f"  [*] --> {gait.initial}"]
    for edge in gait.transitions:
        label = f"{edge.when.text}, {_conditions(gait, edge)}"
        lines.append(f"  {edge.source} --> {edge.target}: {label}")
    return "\n".join(lines) + "\n"


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
