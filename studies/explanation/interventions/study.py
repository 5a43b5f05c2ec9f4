"""Testing every claim of a policy of formulas: its intervention walks, with the same seeds."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.models.files import write_atomically
from glassgait.models.formulas.file import SUFFIX, FormulaFile
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.studies.common.console import say
from glassgait.studies.explanation.interventions.derivation import Claim
from glassgait.studies.explanation.interventions.edits import (
    read_back,
    with_input_raised,
    without_input,
    written,
)
from glassgait.studies.explanation.interventions.effects import (
    FOLLOWED,
    Effect,
    angle_effect,
    following_effect,
)
from glassgait.studies.explanation.interventions.walks import Walk
from glassgait.studies.explanation.interventions.words import (
    following_words,
    joint_words,
    unit_of,
)

FOLDER = "edited"
"""Folder of the edited formula files, within that of the results."""

TITLES = {
    "claim": "claim",
    "term": "term",
    "predicted": "predicted",
    "measured": "measured",
    "low": "95 % from",
    "high": "95 % to",
    "unit": "unit",
    "holds": "holds",
    "falls": "falls",
}
"""What people call the columns of tests."""


@dataclass(frozen=True)
class Examiner:
    """Tests claims of one file, and keeps the edited files that did.

    Attributes:
        file: The file.
        plain: The walk of its own policy.
        walk: Lets a policy walk as that did.
        folder: Folder of the results.
    """

    file: FormulaFile
    plain: Walk
    walk: Callable[[FormulaPolicy], Walk]
    folder: Path

    def examine(self, claims: list[Claim]) -> pd.DataFrame:
        """Tests what claims say of joints, then what terms of commands are there for.

        Returns:
            A row a test: `subject`, joint or following; the `claim` in words; its `term`, `joint`
            and `state`; the size `predicted`, NaN where a formula gives a sign alone; the size
            `measured`, the ends `low` and `high` of its 95 % interval, and their `unit`; whether
            the claim `holds`; of how many `robots`; `falls` under the intervention; and `file`, the
            edited formulas that walked.
        """
        symbols = self.file.vocabulary.symbols
        rows = [self._test_joint(number, claim) for number, claim in enumerate(claims, start=1)]
        rows += [
            self._test_following(number, claim, FOLLOWED[symbols[claim.term.input]])
            for number, claim in enumerate(claims, start=1)
            if symbols[claim.term.input] in FOLLOWED
        ]
        return pd.DataFrame(rows)

    def _test_joint(self, number: int, claim: Claim) -> dict[str, object]:
        name = self.file.vocabulary.symbols[claim.term.input]
        note = f"{self._whose(claim)} sees {name} greater by {claim.step:g}; all else is as it was."
        edited = with_input_raised(self.file, claim.term, claim.step)
        path = self._path(number, claim, "raised")
        walk = self._walk(edited, path, note)
        effect = angle_effect(claim, self.plain, walk)
        words = joint_words(claim, self.file.vocabulary)
        row = {"subject": "joint", "claim": words, "predicted": claim.effect, "unit": "rad"}
        return self._row(row, claim, effect, claim.effect, walk, path)

    def _test_following(self, number: int, claim: Claim, score: str) -> dict[str, object]:
        note = f"{self._whose(claim)} is replaced by its mean; all else is as it was."
        path = self._path(number, claim, "without")
        walk = self._walk(without_input(self.file, claim.term, claim.mean), path, note)
        effect = following_effect(score, self.plain, walk)
        symbol = self.file.vocabulary.symbols[claim.term.input]
        row = {
            "subject": "following",
            "claim": following_words(claim, score),
            "predicted": float("nan"),
            "unit": unit_of(symbol),
        }
        return self._row(row, claim, effect, 1.0, walk, path)

    def _row(
        self,
        row: dict[str, object],
        claim: Claim,
        effect: Effect,
        sign: float,
        walk: Walk,
        path: Path,
    ) -> dict[str, object]:
        return {
            **row,
            "term": claim.term.text(self.file.vocabulary.symbols),
            "joint": claim.term.joint_name,
            "state": -1 if claim.term.state is None else claim.term.state,
            "measured": effect.measured,
            "low": effect.measured - effect.margin,
            "high": effect.measured + effect.margin,
            "holds": effect.holds(sign),
            "robots": effect.robots,
            "falls": walk.falls,
            "file": str(path),
        }

    def _walk(self, edited: FormulaFile, path: Path, note: str) -> Walk:
        say(f"walking with {path.name}: {note}")
        text = written(edited, note)
        write_atomically(self.folder / path, text)
        return self.walk(read_back(text))

    def _whose(self, claim: Claim) -> str:
        term = claim.term.text(self.file.vocabulary.symbols)
        where = "" if claim.term.state is None else f" in state {claim.term.state}"
        image = ", and its mirror image," if claim.term.mirrored else ""
        return f"The term {term} of {claim.term.joint_name}{where}{image}"

    def _path(self, number: int, claim: Claim, what: str) -> Path:
        symbol = self.file.vocabulary.symbols[claim.term.input].replace(".", "_")
        return Path(FOLDER) / f"{number}_{claim.term.joint_name}_{symbol}_{what}{SUFFIX}"


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the columns of what `Examiner.examine` returned as people do."""
    named = table.rename(columns=TITLES)
    named["term"] = table["joint"] + ": " + table["term"]
    named["holds"] = ["yes" if holds else "no" for holds in table["holds"]]
    return named[list(TITLES.values())]
