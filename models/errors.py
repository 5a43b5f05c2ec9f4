"""The error that a person's input raises, told in one sentence, and checks that raise it."""

import reprlib
from collections.abc import Sequence
from typing import Any

LONGEST = 120
"""Greatest number of characters of a value in an error's sentence."""

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 80


class InputError(Exception):
    """A file, key or argument that a person gave cannot be used; the message says how to mend it.

    Command lines print the message alone and exit with code 2. It is no ValueError: tyro would
    frame the sentence with its own.
    """


def brief(text: str) -> str:
    """Cuts what a library or a person wrote to a short line, for an error's sentence."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…"


def shown(value: Any) -> str:
    """Writes a value that a person gave into an error's sentence, cut where it is long."""
    try:
        return brief(_SHORT.repr(value))
    except ValueError:
        # Python refuses to write whole numbers of thousands of digits.
        return f"a {type(value).__name__} too long to write"


def refuse_below_one(where: str, config: object, names: Sequence[str]) -> None:
    """Refuses counts, or sequences of them, that are below 1.

    Args:
        where: What the error calls the configuration.
        config: The configuration.
        names: Its counts and sequences.

    Raises:
        InputError: if a count is below 1.
    """
    for name in names:
        value = getattr(config, name)
        counts = value if isinstance(value, Sequence) else [value]
        if any(count < 1 for count in counts):
            raise InputError(f"{where}: {name} is {value}; it must be 1 or more")


def refuse_empty(where: str, config: object, names: Sequence[str]) -> None:
    """Refuses sequences that hold nothing.

    Args:
        where: What the error calls the configuration.
        config: The configuration.
        names: Its sequences.

    Raises:
        InputError: if a sequence is empty.
    """
    for name in names:
        if not getattr(config, name):
            raise InputError(f"{where}: {name} is empty; name one or more")
