"""Testing every claim of a policy of formulas: its intervention walks, with the same seeds."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.files import write_atomically
from glassgait.models.formulas.expression import Expression, canonical, constant, plus
from glassgait.models.formulas.file import SUFFIX, FormulaFile, write_formulas
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.robot import Robot
from glassgait.studies.common.console import say
from glassgait.studies.common.scores import interval
from glassgait.studies.explanation.interventions.claims import (
    Claim,
    following_words,
    joint_words,
    spoken_of,
    unit_of,
)
from glassgait.studies.explanation.interventions.terms import Term
from glassgait.studies.explanation.interventions.walks import Walk


def with_input_raised(file: FormulaFile, term: Term, by: float) -> FormulaFile:
    """Returns a file in which a term sees its input greater by a number; all else sees it as is.

    Args:
        by: How much greater, in the input's unit.
    """
    return _with_added(file, term, term.with_gates(_short(term.weight * by)))


def without_input(file: FormulaFile, term: Term, mean: float) -> FormulaFile:
    """Returns a file in which a term is a number.

    Args:
        mean: What stands in the term's place (rad).
    """
    taken = plus(term.with_input(-term.weight), constant(_short(mean)))
    return _with_added(file, term, taken)


def written(file: FormulaFile, note: str) -> str:
    """Writes a file with a line on top for people."""
    return f"# {note}\n{write_formulas(file)}"


def read_back(text: str, robot: Robot | None = None) -> FormulaPolicy:
    """Builds the policy that a text of `written` is, so that what is kept is what walks."""
    return FormulaPolicy.from_file(read_formulas(text), robot)


def _with_added(file: FormulaFile, term: Term, added: Expression) -> FormulaFile:
    # The formula itself stays as it is, and ends in what was done to it.
    edited = canonical(plus(file.formulas[term.place], added))
    formulas = {**file.formulas, term.place: edited}
    if term.mirrored:
        assert file.mirror is not None
        mirror = FormulaMirror.of(file.vocabulary, file.mirror)
        formulas[mirror.place(term.place)] = mirror.formula(edited, term.joint)
    return replace(file, formulas=formulas)


def _short(value: float) -> float:
    """Rounds a number to what a file holds in few digits."""
    return float(f"{value:.4g}")


FOLLOWED = {"cmd.v": "going_speed_error", "cmd.yaw": "yaw_rate_error", "e.v": "going_speed_error"}
"""Score that a term of an input is there for: how far the robot is from its command."""


@dataclass(frozen=True)
class Effect:
    """A difference that an intervention makes, paired by robot.

    Attributes:
        measured: Mean over robots.
        margin: Half of its 95 % interval; NaN of fewer than two robots.
        robots: Number of robots that it is of.
    """

    measured: float
    margin: float
    robots: int

    def holds(self, sign: float) -> bool:
        """Returns whether the effect has a sign, and its interval excludes 0."""
        return bool(np.sign(sign) * self.measured > self.margin)


def paired_effect(with_it: Array, without: Array) -> Effect:
    """Compares robots with themselves.

    Args:
        with_it: A number of each robot under the intervention (n,); NaN where there is none.
        without: The same without it (n,).
    """
    difference = pd.Series(with_it - without).dropna()
    mean = float(difference.mean()) if len(difference) else float("nan")
    return Effect(mean, interval(difference), len(difference))


def angle_effect(claim: Claim, plain: Walk, edited: Walk) -> Effect:
    """Measures how far a claim's joint is moved, at the instants that it speaks of (rad)."""
    return paired_effect(_mean_angle(claim, edited), _mean_angle(claim, plain))


def following_effect(score: str, plain: Walk, edited: Walk) -> Effect:
    """Measures by how much more robots miss their commands (m/s or rad/s)."""
    return paired_effect(*(walk.scores[score].to_numpy(dtype=float) for walk in (edited, plain)))


def _mean_angle(claim: Claim, walk: Walk) -> Array:
    """Returns the joint's mean angle of each robot (n,); NaN where the claim speaks of nothing."""
    mask = spoken_of(claim, walk)
    counts = mask.sum(axis=0)
    total = np.where(mask, walk.angle[..., claim.term.joint], 0.0).sum(axis=0)
    return np.where(counts > 0, total / np.maximum(counts, 1), np.nan)


FOLDER = "edited"
"""Folder of the edited formula files, within that of the results."""


@dataclass(frozen=True)
class Examiner:
    """Tests claims of one policy, and keeps the edited files that did.

    Attributes:
        plain: The policy's own walk.
        walk: Lets a policy walk as that did.
        folder: Folder of the results.
    """

    policy: FormulaPolicy
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
        numbered = list(enumerate(claims, start=1))
        rows = [self._test_joint(number, claim) for number, claim in numbered]
        rows += [
            self._test_following(number, claim)
            for number, claim in numbered
            if self._symbol(claim) in FOLLOWED
        ]
        return pd.DataFrame(rows)

    @cached_property
    def file(self) -> FormulaFile:
        """What the policy's file says."""
        return self.policy.to_file()

    def _symbol(self, claim: Claim) -> str:
        return self.policy.vocabulary.symbols[claim.term.input]

    def _test_joint(self, number: int, claim: Claim) -> dict[str, object]:
        edited = with_input_raised(self.file, claim.term, claim.step)
        note = f"sees {self._symbol(claim)} greater by {claim.step:g}"
        walk, path = self._walk(edited, number, claim, "raised", note)
        effect = angle_effect(claim, self.plain, walk)
        words = joint_words(claim, self.policy.vocabulary)
        row = {"subject": "joint", "claim": words, "predicted": claim.effect, "unit": "rad"}
        return row | self._measured(claim, effect, claim.effect, walk, path)

    def _test_following(self, number: int, claim: Claim) -> dict[str, object]:
        score, unit = FOLLOWED[self._symbol(claim)], unit_of(self._symbol(claim))
        edited = without_input(self.file, claim.term, claim.mean)
        walk, path = self._walk(edited, number, claim, "without", "is replaced by its mean")
        effect = following_effect(score, self.plain, walk)
        words = following_words(claim, score)
        row = {"subject": "following", "claim": words, "predicted": float("nan"), "unit": unit}
        return row | self._measured(claim, effect, 1.0, walk, path)

    def _walk(
        self, edited: FormulaFile, number: int, claim: Claim, what: str, note: str
    ) -> tuple[Walk, Path]:
        """Writes a file, and lets the policy walk that is read from it."""
        term, symbol = claim.term, self._symbol(claim).replace(".", "_")
        path = Path(FOLDER) / f"{number}_{term.joint_name}_{symbol}_{what}{SUFFIX}"
        where = "" if term.state is None else f" in state {term.state}"
        image = ", and its mirror image," if term.mirrored else ""
        whose = f"The term {term.text(self.policy.vocabulary.symbols)} of {term.joint_name}"
        note = f"{whose}{where}{image} {note}; all else is as it was."
        say(f"walking with {path.name}: {note}")
        text = written(edited, note)
        write_atomically(self.folder / path, text)
        return self.walk(read_back(text, self.policy.robot)), path

    def _measured(
        self, claim: Claim, effect: Effect, sign: float, walk: Walk, path: Path
    ) -> dict[str, object]:
        return {
            "term": claim.term.text(self.policy.vocabulary.symbols),
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


def readable_table(table: pd.DataFrame) -> pd.DataFrame:
    """Names the columns of what `Examiner.examine` returned as people do."""
    named = table.rename(columns={"low": "95 % from", "high": "95 % to"})
    named["term"] = table["joint"] + ": " + table["term"]
    named["holds"] = ["yes" if holds else "no" for holds in table["holds"]]
    sizes = ["predicted", "measured", "95 % from", "95 % to", "unit"]
    return named[["claim", "term", *sizes, "holds", "falls"]]
