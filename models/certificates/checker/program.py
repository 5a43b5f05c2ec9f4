"""Programs that stand in formula files with other numbers, and are the same but for these."""

import re

from .robot import refuse_unless

NUMBER = r"([0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?)"
STANDS_FOR_ONE = r"[A-Z]{3,}"


def read_program(title: str, statements: list[str], wanted: tuple[str, ...]) -> dict[str, float]:
    """Returns the numbers of a program by the words that stand for them, in small letters.

    Args:
        title: What a refusal calls it.
        statements: The statements that a file holds.
        wanted: Those that it must hold, words in capitals standing for numbers.
    """
    refuse_unless(len(statements) == len(wanted), f"the policy's {title} is another program")
    said: dict[str, float] = {}
    for statement, own in zip(statements, wanted, strict=True):
        found = re.fullmatch(pattern(own), " ".join(statement.split()))
        refuse_unless(found, f"the policy's {title} is another program")
        words = re.findall(STANDS_FOR_ONE, own)
        for word, number in zip(words, found.groups() if found else (), strict=True):
            same = said.setdefault(word.lower(), float(number)) == float(number)
            refuse_unless(same, f"the {word.lower()} of {title} is said twice, and differs")
    return said


def pattern(wanted: str) -> str:
    """Returns what a statement matches, whose words stand apart, with any numbers."""
    tokens = re.findall(r"[A-Za-z0-9_.]+|[^ A-Za-z0-9_.]", wanted)
    whole = ""
    for before, token in zip(["", *tokens], tokens, strict=False):
        apart = " +" if re.fullmatch(r"[\w.]+", before) and re.fullmatch(r"[\w.]+", token) else " *"
        whole += apart + (NUMBER if re.fullmatch(STANDS_FOR_ONE, token) else re.escape(token))
    return whole
