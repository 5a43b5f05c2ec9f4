"""An edit session: versions of a formula policy, with undo, diff and a file of the result."""

import difflib
import itertools
from pathlib import Path

from glassgait.models.files import write_atomically
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import write_formulas
from glassgait.models.formulas.grammar import parse_formula, write_formula
from glassgait.models.formulas.mirror import Place
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy


class EditSession:
    """The versions of a policy whose formulas are edited.

    Mirror images, which the file leaves out, change with the formulas in the file.
    """

    def __init__(self, policy: FormulaPolicy, expert: Policy) -> None:
        # A file without odometry needs its expert's estimator.
        self._expert = expert
        self._versions = [policy]
        self._at = 0
        self.places: tuple[Place, ...] = tuple(policy.to_file().written())
        self._saved: Path | None = None

    @property
    def policy(self) -> FormulaPolicy:
        return self._versions[self._at]

    def text(self, place: Place) -> str:
        formula = self.policy.to_file().formulas[place]
        return write_formula(formula, self.policy.vocabulary.symbols)

    def terms(self, place: Place) -> list[tuple[Expression, str]]:
        symbols, formula = self.policy.vocabulary.symbols, self.policy.to_file().formulas[place]
        return [(term, write_formula(term, symbols)) for term in formula.terms()]

    def replace(self, place: Place, text: str) -> None:
        file = self.policy.to_file()
        formula = parse_formula(text, file.vocabulary.symbols)
        edited = file.with_written({**file.written(), place: formula})
        policy = FormulaPolicy.from_file(edited, self.policy.robot)
        if policy.estimator is None:
            policy = policy.with_estimator_of(self._expert)
        # Drop versions that were undone.
        self._versions[self._at + 1 :] = [policy]
        self._at = len(self._versions) - 1

    def undo(self) -> None:
        self._at = max(0, self._at - 1)

    def redo(self) -> None:
        self._at = min(len(self._versions) - 1, self._at + 1)

    def reset(self) -> None:
        """Goes back to the original; later versions can be redone."""
        self._at = 0

    def diff(self) -> list[str]:
        """Returns the changed lines of the file as a unified diff without its head."""
        before, after = (
            write_formulas(policy.to_file()).splitlines()
            for policy in (self._versions[0], self.policy)
        )
        return list(difflib.unified_diff(before, after, lineterm="", n=0))[2:]

    def save(self, folder: Path, stem: str) -> Path:
        """Writes the current version to this session's file, and returns the path."""
        if self._saved is None:
            names = itertools.chain([stem], (f"{stem}_{number}" for number in itertools.count(2)))
            paths = (folder / f"{name}{FormulaPolicy.suffix}" for name in names)
            self._saved = next(path for path in paths if not path.exists())
        write_atomically(self._saved, write_formulas(self.policy.to_file()))
        return self._saved
