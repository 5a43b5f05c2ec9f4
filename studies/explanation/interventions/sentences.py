"""Sentences: what the largest term of each formula says, and whether robots did so."""

import json
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from glassgait.models.errors import InputError
from glassgait.models.files import write_atomically

SUFFIX = "_sentences.json"
"""Ends the name of a file of sentences that lies beside its policy."""

_MIRRORED = {"left": "right", "right": "left", "FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
_SIDES = re.compile(r"\b(left|right)\b|(?<![A-Za-z])(FL|FR|RL|RR)(?![A-Za-z])")
_STATE = re.compile(r",? (early |late )?in state \d+")


@dataclass(frozen=True)
class Sentence:
    """What the largest readable term of a formula says.

    Attributes:
        joint: Joint whose target the formula is.
        state: State of the machine; none where the formula serves all.
        claim: What the term says, in words.
        predicted: How far the target moves by the term alone (rad).
        measured: How far the joint moved (rad).
        margin: Half of the 95 % interval of that (rad).
        holds: Whether the joint moved so.
    """

    joint: str
    state: int | None
    claim: str
    predicted: float
    measured: float
    margin: float
    holds: bool

    def words(self, *, mirrored: bool = False) -> str:
        """Says what the term says as far as it was true, left and right exchanged if mirrored."""
        if not self.holds:
            return "Its largest readable term says something that did not hold on the robot."
        when = _STATE.search(self.claim)
        part = when[1] if when and when[1] else ""
        claim = _STATE.sub(f", {part.strip()} in the state" if part else "", self.claim)
        if mirrored:
            claim = _SIDES.sub(lambda side: _MIRRORED[side[0]], claim)
        return (
            f"{claim}: by {abs(self.measured):.3f} ± {self.margin:.3f} rad in simulation; the term "
            f"alone predicts {abs(self.predicted):.3f}."
        )


@dataclass(frozen=True)
class Sentences:
    """The sentences of a policy.

    Attributes:
        policy: Digest of the policy that robots walked with.
        n_robots: Robots of each walk.
        n_steps: Control steps of each.
        seed: Seed of starts, commands and noise.
        sentences: A sentence of each formula that has a readable term.
    """

    policy: str
    n_robots: int
    n_steps: int
    seed: int
    sentences: tuple[Sentence, ...]

    def write(self, path: Path) -> None:
        """Writes the sentences as JSON, atomically."""
        write_atomically(path, json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n")

    def of_places(self) -> dict[tuple[int | None, str], Sentence]:
        """Returns the sentences by state and joint."""
        return {(own.state, own.joint): own for own in self.sentences}


def tested_sentences(table: pd.DataFrame) -> tuple[Sentence, ...]:
    """Makes the sentences of what `Examiner.examine` returned of a claim of each formula."""
    joints = table[table["subject"] == "joint"]
    return tuple(
        Sentence(
            joint=row["joint"],
            state=int(row["state"]) if row["state"] >= 0 else None,
            claim=row["claim"],
            predicted=_short(row["predicted"]),
            measured=_short(row["measured"]),
            margin=_short(row["high"] - row["measured"]),
            holds=bool(row["holds"]),
        )
        for row in joints.to_dict(orient="records")
    )


def find_sentences(policy: str, paths: Iterable[Path]) -> Sentences | None:
    """Reads the first file that holds the sentences of a policy.

    Args:
        policy: The policy's digest.
        paths: Files in which they may be.

    Raises:
        InputError: if a file holds no sentences.
    """
    for path in paths:
        if path.exists():
            found = _read(path)
            if found.policy == policy:
                return found
    return None


def _read(path: Path) -> Sentences:
    try:
        data: Any = json.loads(path.read_text())
        own = tuple(Sentence(**sentence) for sentence in data.pop("sentences"))
        return Sentences(**data, sentences=own)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(
            f"{path}: holds no sentences; write them with 'glassgait explain interventions --each'"
        ) from error


def _short(value: float) -> float:
    return float(f"{value:.4g}")
