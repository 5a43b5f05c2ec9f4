"""Boolean formulas over the feet's contacts, as gait files hold them.

A formula such as `FL & RR & ~FR & ~RL` is read by Python's grammar, restricted to the names of the
feet, `&`, `|`, `~` and parentheses. Nothing is executed. It is kept as a truth table over the 16
stances.
"""

import ast
import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glassgait.models.errors import InputError, shown
from glassgait.models.robots.quadruped import LEGS, N_LEGS

N_STANCES: Final = 2**N_LEGS

STANCES: Final[NDArray[np.bool_]] = (np.arange(N_STANCES)[:, None] >> np.arange(N_LEGS) & 1).astype(
    bool
)
"""The feet that touch (16, 4), by stance code; foot i contributes 2**i to the code."""

LONGEST_FORMULA = 1000
"""Greatest number of characters of a formula; every formula over four feet can be shorter."""

_FOREIGN = re.compile(r"[^A-Za-z_&|~()\s]")


@dataclass(frozen=True)
class Formula:
    """A boolean formula over the feet's contacts.

    Attributes:
        text: The formula as written.
        table: Whether it holds, by stance code (16).
    """

    text: str
    table: tuple[bool, ...]

    @property
    def swing_feet(self) -> tuple[bool, ...]:
        """The feet (4) that are in the air in every stance where the formula holds."""
        holds = np.array(self.table)
        return tuple(bool(foot) for foot in ~np.any(STANCES[holds], axis=0))


def stance_code(contact: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Encodes contacts (..., 4) as stance codes (...) in 0..15."""
    return contact.astype(np.intp) @ (1 << np.arange(contact.shape[-1]))


def parse_formula(text: str) -> Formula:
    """Reads a formula.

    Raises:
        InputError: if the text is not a formula over FL, FR, RL and RR, or can never hold.
    """
    # Line breaks would end the formula early, and break the drawings that hold it.
    text = " ".join(text.split())
    if len(text) > LONGEST_FORMULA:
        raise InputError(
            f"formula {shown(text)} is longer than {LONGEST_FORMULA} characters; simplify it"
        )
    # Python's parser, which reads whole programs, should never see anything else.
    if foreign := _FOREIGN.search(text):
        raise _foreign(foreign[0])
    try:
        table = _evaluate(ast.parse(text, mode="eval").body)
    except (SyntaxError, RecursionError, MemoryError, ValueError) as error:
        raise InputError(
            f"formula {shown(text)} cannot be read; write it like 'FL & RR & ~FR & ~RL'"
        ) from error
    if not table.any():
        raise InputError(f"formula {shown(text)} can never hold; remove a contradiction from it")
    return Formula(text, tuple(bool(value) for value in table))


def _foreign(text: str) -> InputError:
    return InputError(
        f"{shown(text)} does not belong in a formula; "
        "use foot names with & (and), | (or), ~ (not) and parentheses"
    )


def _evaluate(node: ast.expr) -> NDArray[np.bool_]:
    match node:
        case ast.Name(id=name) if name in LEGS:
            return STANCES[:, LEGS.index(name)]
        case ast.Name(id=name):
            raise InputError(f"unknown foot {shown(name)}; the feet are {', '.join(LEGS)}")
        case ast.UnaryOp(op=ast.Invert(), operand=operand):
            return ~_evaluate(operand)
        case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
            return _evaluate(left) & _evaluate(right)
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            return _evaluate(left) | _evaluate(right)
        case _:
            raise _foreign(ast.unparse(node))
