"""The error for bad input, and helpers that write its one sentence."""

import reprlib
from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

LONGEST = 120  # greatest number of characters of a value in an error's sentence

_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 80


class InputError(Exception):
    """A user's file, key or argument cannot be used; the message says how to correct it.

    It is not a ValueError, because tyro would wrap the message in its own.
    """


def unknown_name(kind: str, name: object, known: Iterable[str], remedy: str = "") -> InputError:
    """Returns the error for an unknown name; it suggests the closest known one."""
    names = tuple(known)
    near = "".join(f", perhaps {match!r}" for match in get_close_matches(str(name), names, n=1))
    plural = f"{kind}s".replace("ys", "ies")
    return InputError(
        f"unknown {kind} {shown(str(name))}{near}; the {plural} are {', '.join(names)}{remedy}"
    )


def brief(text: str) -> str:
    """Shortens a library's or a user's text to one line for an error message."""
    line = " ".join(text.split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…"


def shown(value: Any) -> str:
    """Formats a user's value for an error message, and shortens a long one."""
    return brief(_SHORT.repr(value))
