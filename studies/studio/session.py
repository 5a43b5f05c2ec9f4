"""An edit session: the numbers of a formula file, the changes made to them, and the way back."""

import difflib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.expression import LARGEST
from glassgait.models.formulas.file import FormulaFile, write_formulas
from glassgait.models.formulas.numbers import FileNumbers
from glassgait.models.formulas.text import written_number

MOST_VERSIONS = 1000
"""Versions that can be undone; the oldest are forgotten."""


@dataclass(frozen=True)
class Version:
    """The numbers at one moment of a session.

    Attributes:
        numbers: The file's numbers (p), in its order.
        off: What numbers were that are 0 because their term is switched off, by index.
        change: What was done last, in words.
    """

    numbers: tuple[float, ...]
    off: Mapping[int, float] = field(default_factory=dict)
    change: str = ""


class EditSession:
    """The numbers of a formula file, with undo and redo.

    Attributes:
        numbered: The file that it began with, and where its numbers stand.
        text: The file's text as it was read.
    """

    def __init__(self, numbered: FileNumbers, text: str) -> None:
        """
        Args:
            numbered: The file.
            text: Its text, which is what the session writes so long as nothing is changed.
        """
        self.numbered = numbered
        self.text = text
        self._versions = [Version(numbered.start)]
        self._at = 0
        self._dragged: int | None = None
        self._file = numbered.start, numbered.file

    @property
    def version(self) -> Version:
        """The version that counts."""
        return self._versions[self._at]

    @property
    def numbers(self) -> tuple[float, ...]:
        """The numbers that count (p)."""
        return self.version.numbers

    def shown(self, index: int) -> float:
        """Returns a number as it is, or was before its term was switched off."""
        return self.version.off.get(index, self.numbers[index])

    def change(self, index: int, value: float, *, goes_on: bool = False) -> None:
        """Changes a number; that of a term that is switched off counts once that is on again.

        Args:
            index: Which number, in the file's order.
            value: What it is to be.
            goes_on: Whether it is one with the change before it, if that was of the same number
                and nothing else came between: what is dragged is undone at once.

        Raises:
            InputError: if there is no such number, or the value cannot stand in a file.
        """
        self._refuse_unknown(index)
        if not isfinite(value) or abs(value) > LARGEST:
            raise InputError(f"a number of a formula is {shown(value)}; give a smaller one")
        now = self.version
        words = f"{written_number(self.shown(index))} → {written_number(value)}"
        if index in now.off:
            own = replace(now, off={**now.off, index: value})
        else:
            own = replace(now, numbers=_with(now.numbers, index, value))
        self._add(replace(own, change=words), goes_on=goes_on and self._dragged == index)
        self._dragged = index

    def switch(self, index: int, on: bool) -> None:
        """Switches the term off that a number stands before, or on again.

        Raises:
            InputError: if there is no such number.
        """
        self._refuse_unknown(index)
        now = self.version
        if on == (index not in now.off):
            return
        if on:
            off = {own: value for own, value in now.off.items() if own != index}
            numbers, change = _with(now.numbers, index, now.off[index]), "switched on"
        else:
            off = {**now.off, index: now.numbers[index]}
            numbers, change = _with(now.numbers, index, 0.0), "switched off"
        self._add(Version(numbers, off, change))

    def reset(self) -> None:
        """Goes back to the file that it began with, which can be undone as well."""
        if self.is_changed or self.version.off:
            self._add(Version(self.numbered.start, {}, "as it was"))

    @property
    def can_undo(self) -> bool:
        """Whether there is a version before."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a version that was undone."""
        return self._at + 1 < len(self._versions)

    def undo(self) -> None:
        """Goes back one version, if there is one."""
        self._at -= self.can_undo
        self._dragged = None

    def redo(self) -> None:
        """Goes on one version, if there is one."""
        self._at += self.can_redo
        self._dragged = None

    @property
    def is_changed(self) -> bool:
        """Whether a number is another one than in the file that it began with."""
        return self.numbers != self.numbered.start

    def changed(self) -> tuple[int, ...]:
        """Returns which numbers are others than in the file that it began with."""
        pairs = enumerate(zip(self.numbers, self.numbered.start, strict=True))
        return tuple(index for index, (now, before) in pairs if now != before)

    def file(self) -> FormulaFile:
        """Returns the file with the numbers that count."""
        numbers, file = self._file
        if numbers != self.numbers:
            numbers = self.numbers
            file = self.numbered.replaced(numbers)
            self._file = numbers, file
        return file

    def written(self) -> str:
        """Returns the text of the file with the numbers that count."""
        return write_formulas(self.file()) if self.is_changed else self.text

    def digest(self) -> str:
        """Returns the SHA-256 of that text, as certificates name it."""
        return hashlib.sha256(self.written().encode()).hexdigest()

    def diff(self) -> tuple[str, ...]:
        """Returns what has changed, as lines of a unified diff without its head."""
        if not self.is_changed:
            return ()
        before = write_formulas(self.numbered.file).splitlines()
        lines = difflib.unified_diff(before, self.written().splitlines(), lineterm="", n=0)
        return tuple(lines)[2:]

    def _add(self, version: Version, *, goes_on: bool = False) -> None:
        first = self._at if goes_on else self._at + 1
        self._versions[first:] = [version]
        del self._versions[: len(self._versions) - MOST_VERSIONS]
        self._at = len(self._versions) - 1
        self._dragged = None

    def _refuse_unknown(self, index: int) -> None:
        if not 0 <= index < len(self.numbers):
            raise InputError(
                f"number {index} is not in the file; name one from 0 to {len(self.numbers) - 1}"
            )


def _with(numbers: Sequence[float], index: int, value: float) -> tuple[float, ...]:
    return (*numbers[:index], value, *numbers[index + 1 :])
