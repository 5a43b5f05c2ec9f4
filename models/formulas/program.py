"""Programs in formula files: statements that are the same in every file, but for a few numbers.

What a program says, Python and the C of a controller do; a person reads it, and may edit the
numbers.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import zip_longest
from types import MappingProxyType

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.text import TextError, written_number

_TOKEN = re.compile(r"[0-9.]+(?:[eE][+-]?[0-9]+)?|[A-Za-z_][A-Za-z0-9_.]*|\S")

_QUANTITIES = re.compile(r"(?:^|(?<=[;.] ))(\w+(?:, \w+)*)(?=: )")
"""Names in a legend: words alone, from the beginning of a clause to a colon."""


@dataclass(frozen=True)
class Number:
    """A number of a program that may be edited.

    Attributes:
        name: What a refusal calls it, such as "the gain".
        range: What it may be, in words.
        check: Raises an `InputError` for a number that it may not be.
    """

    name: str
    range: str
    check: Callable[[float], object]


@dataclass(frozen=True)
class Program:
    """A program.

    Attributes:
        title: The title of its section.
        legend: What its quantities are: the text of comments above it.
        statements: The statements, and what each gives.
        numbers: Numbers that may be edited, by the word that stands for each in a statement.
    """

    title: str
    legend: tuple[str, ...]
    statements: tuple[tuple[str, str], ...]
    numbers: Mapping[str, Number] = field(default_factory=dict)

    def quantities(self) -> Iterator[tuple[str, str]]:
        """Splits the legend where it names a quantity: each name, and the words after it."""
        _, *parts = _QUANTITIES.split(" ".join(self.legend))
        for names, words in zip(parts[::2], parts[1::2], strict=True):
            *others, last = names.split(", ")
            yield from ((name, ", ") for name in others)
            yield last, words

    def lines(self, values: Mapping[str, float] = MappingProxyType({})) -> list[str]:
        """Writes the program, with what its quantities are and with its numbers."""
        return [*(f"# {line}" for line in self.legend), *self._written(values)]

    def _written(self, values: Mapping[str, float]) -> Iterator[str]:
        for statement, note in self.statements:
            text = re.sub(r"[A-Z]{3,}", lambda word: written_number(values[word[0]]), statement)
            yield f"{text}    # {note}" if note else text

    def refuse_end(self, count: int, line: int) -> None:
        """Refuses an end before the last statement.

        Args:
            count: How many statements were read.
            line: The line in the file.

        Raises:
            TextError: if there are more.
        """
        if count < len(self.statements):
            missing = self.statements[count][0]
            raise TextError(f"{self.title} lacks {missing!r}; add it above", line, 1)

    def read(self, count: int, text: str, line: int) -> dict[str, float]:
        """Reads a statement.

        Args:
            count: How many statements were read before.
            text: The statement, without comments.
            line: Its line in the file.

        Returns:
            The numbers that stand in it, by their words.

        Raises:
            TextError: if it is not that statement up to its numbers, or one is out of range.
        """
        if count >= len(self.statements):
            last = self.statements[-1][0]
            raise TextError(f"{self.title} ends with {shown(last)}; leave this out", line, 1)
        statement, found = self.statements[count][0], {}
        for own, wanted in zip_longest(_TOKEN.finditer(text), _TOKEN.findall(statement)):
            column = own.start() + 1 if own else len(text) + 1
            if own and wanted in self.numbers:
                value = self._number(wanted, own[0], line, column)
                if found.setdefault(wanted, value) != value:
                    name = self.numbers[wanted].name
                    raise TextError(f"{name} stands twice, and differs; give one", line, column)
            elif own is None or own[0] != wanted:
                free = ", of which {} alone may be edited" if self.numbers else ""
                raise TextError(
                    f"{self.title} is one program{free.format(', '.join(self.numbers))}; write "
                    f"{statement!r}",
                    line,
                    column,
                )
        return found

    def _number(self, word: str, text: str, line: int, column: int) -> float:
        number = self.numbers[word]
        try:
            value = float(text)
            number.check(value)
        except (ValueError, InputError) as error:
            raise TextError(
                f"{number.name} is {shown(text)}; write a number {number.range}", line, column
            ) from error
        return value
