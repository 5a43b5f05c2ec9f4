"""Draws a reward machine as text, and colours its states."""

from itertools import cycle

from glassgait.models.task.gait import Gait, Transition

COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00")
"""Colours by Okabe and Ito, which colour-blind readers can tell apart."""

FAULT_COLORS = ("#999999", "#BBBBBB", "#777777")
"""Greys for fault states, which are not part of the gait."""


def state_colors(gait: Gait) -> tuple[str, ...]:
    """Returns the colour of each state of a gait's machine, as #rrggbb."""
    sound, faulty = cycle(COLORS), cycle(FAULT_COLORS)
    return tuple(next(faulty if state in gait.faults else sound) for state in gait.states)


def ink_on(color: str) -> str:
    """Returns the text colour, black or white, with the higher contrast (WCAG 2.2)."""
    channels = [int(color[start : start + 2], 16) / 255 for start in (1, 3, 5)]
    red, green, blue = (
        value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4
        for value in channels
    )
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return "#000000" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#ffffff"


def to_text(gait: Gait) -> str:
    """Draws a gait's reward machine as lines of text: each state, then its transitions."""
    lines = []
    for state in gait.states:
        roles = {"initial": state == gait.initial, "at fault": state in gait.faults}
        lines.append(", ".join([state, *(role for role, applies in roles.items() if applies)]))
        for edge in gait.transitions:
            if edge.source == state:
                label = ", ".join([edge.when.text, *_conditions(gait, edge)])
                lines.append(f"  └─ {label} → {edge.target}")
    return "\n".join(lines)


def _conditions(gait: Gait, edge: Transition) -> list[str]:
    share = "" if edge.dwell == 1 else f"{edge.dwell:g} × "
    conditions = {
        f"after {share}dwell": edge.dwell > 0,
        f"swing feet ≥ {gait.clearance:g} m": any(edge.when.swing_feet),
        f"from step {edge.grace}": edge.grace > 0,
    }
    return [text for text, applies in conditions.items() if applies]
