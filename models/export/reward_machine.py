"""The C of a reward machine: its states, and the conditions under which it moves on."""

import ast
import textwrap
from collections.abc import Callable, Sequence
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
    return constants(f"{own.upper()}STATE_", gait.states)


def constants(begin: str, states: Sequence[str]) -> tuple[str, ...]:
    """Names the constants of states as they are called, or else by their numbers."""
    names = [f"{begin}{state.upper()}" for state in states]
    if len(set(names)) < len(names) or not all(is_identifier(name) for name in names):
        return tuple(f"{begin}{number}" for number in range(len(states)))
    return tuple(names)


def cases(gait: Gait, real: Real, own: str = "") -> list[Case]:
    """Writes the transitions of each state that has any; see `state_constants`."""
    named = dict(zip(gait.states, state_constants(gait, own), strict=True))
    found = []
    for state in gait.states:
        leaving = [edge for edge in gait.transitions if edge.source == state]
        exits = tuple(
            (commented(edge.when.text), _condition(edge, real), named[edge.target])
            for edge in leaving
        )
        if exits:
            found.append(Case(named[state], exits))
    return found


def _condition(edge: Transition, real: Real) -> tuple[str, ...]:
    """Returns the lines of a condition over `now`, the propositions of a control step."""
    parts = conjuncts(edge.when.text, lambda foot: f"now->contact[{foot}]")
    swing = [
        leg for leg, swings in zip(quadruped.LEGS, edge.when.swing_feet, strict=True) if swings
    ]
    parts += [f"now->height[{leg}] >= CLEARANCE" for leg in swing]
    if edge.dwell > 0.0:
        share = "" if edge.dwell == 1.0 else f"{number(edge.dwell, real)} * "
        parts.append(f"now->spent >= {share}now->dwell")
    if edge.grace > 0:
        parts.append(f"now->age >= {edge.grace}")
    return condition_lines(parts)


def condition_lines(parts: list[str]) -> tuple[str, ...]:
    """Writes what must all hold on as many lines as it takes."""
    glued = [part.replace(" ", GLUE) for part in parts]
    lines = textwrap.wrap(f" &&{GLUE}".join(glued), LINE_LENGTH - 14, break_long_words=False)
    return tuple(line.replace(GLUE, " ") for line in lines)


def conjuncts(formula: str, name: Callable[[str], str]) -> list[str]:
    """Lists what must all hold, of a boolean formula that was read and checked with its file.

    Args:
        formula: The formula.
        name: Writes one of its names.
    """
    return _conjuncts(ast.parse(formula, mode="eval").body, name)


def _conjuncts(node: ast.expr, name: Callable[[str], str]) -> list[str]:
    match node:
        case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
            return [*_conjuncts(left, name), *_conjuncts(right, name)]
        case _:
            return [_written(node, name)]


def _written(node: ast.expr, name: Callable[[str], str]) -> str:
    match node:
        case ast.Name(id=own):
            return name(own)
        case ast.UnaryOp(operand=operand):
            return f"!{_written(operand, name)}"
        case ast.BinOp(left=left, op=operator, right=right):
            sign = "&&" if isinstance(operator, ast.BitAnd) else "||"
            return f"({_written(left, name)} {sign} {_written(right, name)})"
    raise AssertionError(ast.unparse(node))
