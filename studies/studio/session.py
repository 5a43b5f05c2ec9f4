"""An edit session: versions of a formula policy, with undo, diff and a file of the result."""

import difflib
from pathlib import Path

from glassgait.models.files import write_atomically
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import write_formulas
from glassgait.models.formulas.grammar import parse_formula, write_formula
from glassgait.models.formulas.mirror import Place
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy

MOST_VERSIONS = 1000
"""Versions that can be undone; the oldest are forgotten."""


class EditSession:
    """The versions of a policy whose formulas are edited.

    Formulas that the file leaves out, because they are mirror images, follow those that it holds.

    Attributes:
        places: Places of the formulas that the file holds.
    """

    def __init__(self, policy: FormulaPolicy, expert: Policy) -> None:
        """
        Args:
            policy: The policy to start from.
            expert: Its expert, whose estimator a file without odometry needs.
        """
        self._expert = expert
        self._versions = [policy]
        self._at = 0
        self.places: tuple[Place, ...] = tuple(policy.to_file().written())
        self._saved: Path | None = None

    @property
    def policy(self) -> FormulaPolicy:
        """The current version."""
        return self._versions[self._at]

    @property
    def original(self) -> FormulaPolicy:
        """The version that the session started from."""
        return self._versions[0]

    @property
    def is_changed(self) -> bool:
        """Whether the current version differs from the original."""
        return self.policy is not self.original

    def text(self, place: Place) -> str:
        """Returns a formula as its file writes it, on one line."""
        return write_formula(self._formula(place), self.policy.vocabulary.symbols)

    def terms(self, place: Place) -> list[tuple[Expression, str]]:
        """Returns the terms of a formula, each with its text."""
        symbols = self.policy.vocabulary.symbols
        return [(term, write_formula(term, symbols)) for term in self._formula(place).terms()]

    def replace(self, place: Place, text: str) -> None:
        """Replaces a formula by text in the syntax of the file.

        Raises:
            InputError: if the text is not a formula, or its names are unknown.
        """
        file = self.policy.to_file()
        formula = parse_formula(text, file.vocabulary.symbols)
        formulas = {**file.written(), place: formula}
        edited = file.with_written(file.written_definitions(), formulas)
        policy = FormulaPolicy.from_file(edited, self.policy.robot)
        if policy.estimator is None:
            policy = policy.with_estimator_of(self._expert)
        self._versions[self._at + 1 :] = [policy]
        # The original stays, for the diff and for `reset`.
        del self._versions[1 : len(self._versions) - MOST_VERSIONS]
        self._at = len(self._versions) - 1

    def _formula(self, place: Place) -> Expression:
        return self.policy.to_file().formulas[place]

    def undo(self) -> None:
        """Goes back one version if possible."""
        self._at = max(0, self._at - 1)

    def redo(self) -> None:
        """Goes forward one version if possible."""
        self._at = min(len(self._versions) - 1, self._at + 1)

    def reset(self) -> None:
        """Goes back to the original; later versions can be redone."""
        self._at = 0

    def diff(self) -> list[str]:
        """Returns the changed lines of the file as a unified diff without its head."""
        before, after = (
            write_formulas(policy.to_file()).splitlines() for policy in (self.original, self.policy)
        )
        return list(difflib.unified_diff(before, after, lineterm="", n=0))[2:]

    def save(self, folder: Path, stem: str) -> Path:
        """Writes the current version to a file of its own, and returns the path.

        A later save of the same session replaces the file; files of other sessions stay.
        """
        path, number = self._saved, 1
        while path is None:
            name = stem if number == 1 else f"{stem}_{number}"
            free = folder / f"{name}{FormulaPolicy.suffix}"
            path, number = (None if free.exists() else free), number + 1
        folder.mkdir(parents=True, exist_ok=True)
        write_atomically(path, write_formulas(self.policy.to_file()))
        self._saved = path
        return path
