"""The C of a reward machine: its states, and the conditions under which it moves on."""

import ast
import textwrap
from dataclasses import dataclass

from glassgait.models.export.language import LINE_LENGTH, Real, commented, is_identifier, number
from glassgait.models.formulas.text import GLUE
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait, Transition


@dataclass(frozen=True)
class Case:
    """What makes the machine leave a state.

    Attributes:
        state: Name of the state's constant.
        exits: For each transition its formula as the gait's file has it, the lines of its
            condition, and the constant of the state that it enters.
    """

    state: str
    exits: tuple[tuple[str, tuple[str, ...], str], ...]


def state_constants(gait: Gait, own: str = "") -> tuple[str, ...]:
    """Names the constant of each state, such as STATE_Q0.

    Args:
        gait: The gait.
        own: What its names begin with, such as `trot_`; none where there is one gait.
    """
    begin = f"{own.upper()}STATE_"
    names = [f"{begin}{state.upper()}" for state in gait.states]
    if len(set(names)) < len(names) or not all(is_identifier(name) for name in names):
        return tuple(f"{begin}{number}" for number in range(gait.n_states))
    return tuple(names)


def cases(gait: Gait, real: Real, own: str = "") -> list[Case]:
    """Writes the transitions of each state that has any; see `state_constants`."""
    constants = dict(zip(gait.states, state_constants(gait, own), strict=True))
    found = []
    for state in gait.states:
        leaving = [edge for edge in gait.transitions if edge.source == state]
        exits = tuple(
            (commented(edge.when.text), _condition(edge, real), constants[edge.target])
            for edge in leaving
        )
        if exits:
            found.append(Case(constants[state], exits))
    return found


def _condition(edge: Transition, real: Real) -> tuple[str, ...]:
    """Returns the lines of a condition over `now`, the propositions of a control step."""
    parts = _conjuncts(ast.parse(edge.when.text, mode="eval").body)
    swing = [
        leg for leg, swings in zip(quadruped.LEGS, edge.when.swing_feet, strict=True) if swings
    ]
    parts += [f"now->height[{leg}] >= CLEARANCE" for leg in swing]
    if edge.dwell > 0.0:
        share = "" if edge.dwell == 1.0 else f"{number(edge.dwell, real)} * "
        parts.append(f"now->spent >= {share}now->dwell")
    if edge.grace > 0:
        parts.append(f"now->age >= {edge.grace}")
    glued = [part.replace(" ", GLUE) for part in parts]
    lines = textwrap.wrap(f" &&{GLUE}".join(glued), LINE_LENGTH - 14, break_long_words=False)
    return tuple(line.replace(GLUE, " ") for line in lines)


def _conjuncts(node: ast.expr) -> list[str]:
    """Lists what must all hold, of a formula that was read and checked with the gait."""
    match node:
        case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
            return [*_conjuncts(left), *_conjuncts(right)]
        case _:
            return [_of_feet(node)]


def _of_feet(node: ast.expr) -> str:
    """Writes a formula over the feet's contacts."""
    match node:
        case ast.Name(id=foot):
            return f"now->contact[{foot}]"
        case ast.UnaryOp(operand=operand):
            return f"!{_of_feet(operand)}"
        case ast.BinOp(left=left, op=operator, right=right):
            sign = "&&" if isinstance(operator, ast.BitAnd) else "||"
            return f"({_of_feet(left)} {sign} {_of_feet(right)})"
    raise AssertionError(ast.unparse(node))
