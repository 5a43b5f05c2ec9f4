"""Odometry as formula files hold it: a text that a person reads, whose gain a person may edit.

What it says, `glassgait.models.task.odometry` does, and the C of a controller.
"""

import re
from itertools import zip_longest

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.text import TextError, written_number
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.imu import GRAVITY
from glassgait.models.task.odometry import SLIP, Odometry

GAIN = "GAIN"
"""Stands for the number that may be edited."""

_NUMBERS = {
    "PERIOD": written_number(CONTROL_PERIOD),
    "GRAVITY": written_number(GRAVITY),
    "SLIP": written_number(SLIP),
}

_PROGRAM = (
    (
        "predicted = v - PERIOD*cross(w, v) + dv + PERIOD*GRAVITY*g",
        "m/s, of the trunk, by the IMU",
    ),
    (
        "sole = dp + cross(w, p) + radius*cross(w + dr, g)",
        "m/s, of each foot's lowest point",
    ),
    ("stood = touching and touching.before", "of each foot: one just come down still moves"),
    ("near = stood and norm(predicted + sole) < SLIP", "one that swings or slips is not near"),
    ("standing = near if any(near) else stood", ""),
    ("measured = mean(-sole, standing)", "m/s, of the trunk, by the feet that stand and roll"),
    ("v = predicted + GAIN*(measured - predicted) if any(standing) else predicted", ""),
    (
        "foothold = p if touching else foothold - PERIOD*(v + cross(w, foothold))",
        "m, of each foot",
    ),
    ("normal = unit(cross(foothold.FR - foothold.RL, foothold.FL - foothold.RR))", "of the ground"),
    ("h = dot(normal, p - mean(foothold))", "m, each foot's height above that plane"),
)
"""The statements of the program, and what they give."""

STATEMENTS = tuple(
    re.sub("|".join(_NUMBERS), lambda name: _NUMBERS[name[0]], statement)
    for statement, _ in _PROGRAM
)
"""The same with all numbers but the gain."""

_LEGEND = (
    "# w: angular velocity, rad/s; dv: change of velocity since the step before, m/s; g: direction",
    "# of gravity; p: where a foot is, m; dp: how fast its joints move it, m/s; dr: how fast they",
    "# turn its shank, rad/s; radius: of a foot, m. By IMU and joints, in the trunk's frame. One",
    "# number of this program may be edited, the gain: above 0, up to 1.",
)

_TOKEN = re.compile(r"[0-9.]+(?:[eE][+-]?[0-9]+)?|[A-Za-z_][A-Za-z0-9_.]*|\S")


def odometry_lines(odometry: Odometry) -> list[str]:
    """Writes odometry, with what its quantities are."""
    gain = written_number(odometry.gain)
    statements = (statement.replace(GAIN, gain) for statement in STATEMENTS)
    notes = (f"    # {note}" if note else "" for _, note in _PROGRAM)
    return [*_LEGEND, *(whole + note for whole, note in zip(statements, notes, strict=True))]


def read_statement(number: int, text: str, line: int) -> Odometry | None:
    """Reads a statement of odometry.

    Args:
        number: Which of the program's statements it is, counted from 0.
        text: The statement, without comments.
        line: Its line in the file.

    Returns:
        The odometry, of the statement that holds its gain.

    Raises:
        TextError: if it is not that statement up to its gain, or the gain is none.
    """
    if number >= len(STATEMENTS):
        raise TextError(f"odometry ends with {shown(STATEMENTS[-1])}; leave this out", line, 1)
    odometry = None
    for own, wanted in zip_longest(_TOKEN.finditer(text), _TOKEN.findall(STATEMENTS[number])):
        column = own.start() + 1 if own else len(text) + 1
        if own and wanted == GAIN:
            odometry = _of_gain(own[0], line, column)
        elif own is None or own[0] != wanted:
            raise TextError(
                f"odometry is one program, of which {GAIN} alone may be edited; write "
                f"{STATEMENTS[number]!r}",
                line,
                column,
            )
    return odometry


def _of_gain(text: str, line: int, column: int) -> Odometry:
    try:
        return Odometry(gain=float(text))
    except (ValueError, InputError) as error:
        raise TextError(
            f"the gain is {shown(text)}; write a number above 0, up to 1", line, column
        ) from error
