"""Boolean formulas: over the feet's contacts, as in gait files, or over other propositions.

A formula such as `FL & RR & ~FR & ~RL` is read by Python's grammar, restricted to names, `&`, `|`,
`~` and parentheses; nothing is ever executed. It is kept as a truth table, of the feet over the 16
stances.
"""

import ast
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glassgait.models.errors import InputError, shown
from glassgait.models.robots import quadruped

N_STANCES: Final = 2**quadruped.N_LEGS


def valuations(count: int) -> NDArray[np.bool_]:
    """Returns the truth values (2**count, count) of propositions; number i adds 2**i to a row."""
    return (np.arange(2**count)[:, None] >> np.arange(count) & 1).astype(bool)


STANCES: Final[NDArray[np.bool_]] = valuations(quadruped.N_LEGS)
"""The feet that touch (16, 4), by stance code; foot i contributes 2**i to the code."""

LONGEST_FORMULA = 1000
"""Greatest number of characters of a formula; every one over four feet can be written in fewer."""

DEEPEST_FORMULA = 50
"""Greatest nesting of a formula's parentheses."""

_FOREIGN = re.compile(r"[^A-Za-z_&|~()\s]")


@dataclass(frozen=True)
class Formula:
    """A boolean formula over propositions, such as the feet's contacts.

    Attributes:
        text: The formula as written.
        table: Whether it holds, by the code of the propositions; of the feet by stance code (16).
    """

    text: str
    table: tuple[bool, ...]

    @property
    def swing_feet(self) -> tuple[bool, ...]:
        """The feet (4) that are in the air in every stance where the formula holds."""
        holds = np.array(self.table)
        return tuple(bool(foot) for foot in ~np.any(STANCES[holds], axis=0))


def stance_code(contact: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Encodes contacts (..., 4) as stance codes (...) in 0..15, and other propositions alike."""
    return contact.astype(np.intp) @ (1 << np.arange(contact.shape[-1]))


@dataclass(frozen=True)
class Names:
    """What the names of a formula stand for.

    Attributes:
        names: The names, in the order of their places in a code.
        one: What a refusal calls one of them.
        all: What it calls all of them.
        example: A formula of them.
    """

    names: Sequence[str]
    one: str
    all: str
    example: str


FEET: Final = Names(quadruped.LEGS, "foot", "feet", "FL & RR & ~FR & ~RL")


def parse_formula(text: str, names: Names = FEET) -> Formula:
    """Reads a formula.

    Raises:
        InputError: if the text is not a formula over the names, by default FL, FR, RL and RR, or
            can never hold.
    """
    # Line breaks would end the formula early, and break the drawings that hold it.
    text = " ".join(text.split())
    _check_text(text, names)
    try:
        tree = ast.parse(text, mode="eval")
        table = _evaluate(tree.body, names)
    except (SyntaxError, RecursionError, MemoryError, ValueError) as error:
        raise InputError(
            f"formula {shown(text)} cannot be read; write it like {names.example!r}"
        ) from error
    if not table.any():
        raise InputError(f"formula {shown(text)} can never hold; remove a contradiction from it")
    return Formula(text, tuple(bool(value) for value in table))


def _check_text(text: str, names: Names) -> None:
    """Refuses what Python's parser, which reads whole programs, had better never see."""
    if len(text) > LONGEST_FORMULA:
        raise InputError(
            f"formula {shown(text)} is longer than {LONGEST_FORMULA} characters; simplify it"
        )
    if foreign := _FOREIGN.search(text):
        raise _foreign(foreign[0], names)
    depth = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if depth > DEEPEST_FORMULA:
            raise InputError(
                f"formula {shown(text)} nests more than {DEEPEST_FORMULA} parentheses; simplify it"
            )


def _foreign(text: str, names: Names) -> InputError:
    return InputError(
        f"{shown(text)} does not belong in a formula; "
        f"use {names.one} names with & (and), | (or), ~ (not) and parentheses"
    )


def _evaluate(node: ast.expr, names: Names) -> NDArray[np.bool_]:
    match node:
        case ast.Name(id=name) if name in names.names:
            return valuations(len(names.names))[:, names.names.index(name)]
        case ast.Name(id=name):
            raise InputError(
                f"unknown {names.one} {shown(name)}; the {names.all} are {', '.join(names.names)}"
            )
        case ast.UnaryOp(op=ast.Invert(), operand=operand):
            return ~_evaluate(operand, names)
        case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
            return _evaluate(left, names) & _evaluate(right, names)
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            return _evaluate(left, names) | _evaluate(right, names)
        case _:
            raise _foreign(ast.unparse(node), names)
