"""The error that bad input raises, in one sentence."""

import reprlib
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

LONGEST = 120  # greatest number of characters of a value in an error's sentence

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 80


class InputError(Exception):
    """A file, key or argument that a person gave cannot be used; the message says how to mend it.

    It is no ValueError: tyro would frame the sentence with its own.
    """


def unknown_name(kind: str, name: object, known: Iterable[str], remedy: str = "") -> InputError:
    """Returns the refusal of a name, with the nearest known one and a further remedy."""
    names = tuple(known)
    near = "".join(f", perhaps {one!r}" for one in get_close_matches(str(name), names, n=1))
    several = f"{kind}s".replace("ys", "ies")
    return InputError(
        f"unknown {kind} {shown(str(name))}{near}; the {several} are {', '.join(names)}{remedy}"
    )


def brief(text: str) -> str:
    """Cuts what a library or a person wrote to a short line, for an error's sentence."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…"


def shown(value: Any) -> str:
    """Formats a user's value for an error message, and shortens a long one."""
    try:
        return brief(_SHORT.repr(value))
    except ValueError:
        # Python refuses to write whole numbers of thousands of digits.
        return f"a {type(value).__name__} too long to write"
