"""The lines in which the files of two policies of formulas differ."""

from dataclasses import dataclass
from difflib import unified_diff

from rich.text import Text

from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.studies.evaluation.compare.sides import Side

STYLES = {"+": "green", "-": "red", "@": "cyan"}
"""Colours of a difference's lines, by the sign that they begin with."""


@dataclass(frozen=True)
class LineChanges:
    """How one file becomes another.

    Attributes:
        lines: Lines of a unified difference, from the file of A to that of B; none where the files
            say the same.
    """

    lines: tuple[str, ...]

    @property
    def only_a(self) -> int:
        """Lines that A's file alone has."""
        return self._count("-")

    @property
    def only_b(self) -> int:
        """Lines that B's file alone has."""
        return self._count("+")

    def _count(self, sign: str) -> int:
        # The first two lines name the files, by the same signs.
        return sum(line.startswith(sign) for line in self.lines[2:])

    def colored(self) -> list[Text]:
        """Returns the lines as a terminal shows them."""
        headings = [Text(line, style="bold") for line in self.lines[:2]]
        rest = [Text(line, style=STYLES.get(line[:1], "")) for line in self.lines[2:]]
        return [*headings, *rest]


def changed_lines(a: Side, b: Side) -> LineChanges | None:
    """Compares what the files of two policies say; None where one is not made of formulas.

    Raises:
        InputError: if the observations are not those of the task.
    """
    if not (isinstance(a.policy, FormulaPolicy) and isinstance(b.policy, FormulaPolicy)):
        return None
    own, other = (policy.to_text().splitlines() for policy in (a.policy, b.policy))
    return LineChanges(tuple(unified_diff(own, other, a.title, b.title, lineterm="")))


def told_changes(a: Side, b: Side, changes: LineChanges | None) -> str:
    """Tells in a sentence how much the files differ, or why there is nothing to compare."""
    if changes is None:
        others = [side for side in (a, b) if not isinstance(side.policy, FormulaPolicy)]
        told = " and ".join(f"{side.letter} is of the kind {side.policy.kind}" for side in others)
        return f"there is no text to compare: {told}, and policies of formulas alone are text"
    if not changes.lines:
        return "the files say the same"
    return f"lines of A alone: {changes.only_a}, of B alone: {changes.only_b}"
