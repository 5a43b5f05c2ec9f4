"""What is certified of the gaits' policies: claims by verdict, and where each is explained."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from glassgait.models.certificates.prover import OUTCOMES
from glassgait.models.certificates.reading import (
    OUTCOME_WORDS,
    Certificate,
    box_in_words,
    finding_in_words,
)
from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import say
from glassgait.studies.distillation.students.library import certificates_of
from glassgait.studies.distillation.students.registry import STUDENTS, policy_title
from glassgait.studies.explanation.command import CONFIG, DIGEST

_VERDICTS = [OUTCOME_WORDS[outcome] for outcome in OUTCOMES]


@dataclass(frozen=True)
class CertifiedPolicy:
    """A policy that has a certificate.

    Attributes:
        title: What the report calls it.
        claims: Its claims by verdict: those that are proved, then refuted, then open.
        page: Its explanation page, from the report's folder; None where there is none.
        explain: The command that writes that page.
    """

    title: str
    claims: pd.DataFrame
    page: str | None
    explain: str


def certified_policies(gaits: Sequence[str], folder: Path) -> list[CertifiedPolicy]:
    """Lists the policies of gaits that have a certificate, made here or shipped.

    Args:
        gaits: Names of the gaits.
        folder: The report's folder.
    """
    return [
        _certified(certificate, gait, folder)
        for gait in map(load_gait, gaits)
        for certificate in certificates_of(gait)
    ]


def verdicts_table(policies: Sequence[CertifiedPolicy]) -> pd.DataFrame:
    """Counts the claims of each policy by verdict."""
    return pd.DataFrame(
        [
            {"policy": policy.title}
            | {word: int((policy.claims["verdict"] == word).sum()) for word in _VERDICTS}
            for policy in policies
        ],
        columns=["policy", *_VERDICTS],
    )


def _certified(certificate: Certificate, gait: Gait, folder: Path) -> CertifiedPolicy:
    stem = Path(certificate.policy_file).stem
    name = stem if stem in STUDENTS else certificate.policy_file
    page = explanation_page(certificate)
    return CertifiedPolicy(
        title=f"{gait.name.capitalize()}: {policy_title(stem)}",
        claims=claims_by_verdict(certificate),
        page=Path(os.path.relpath(page, folder)).as_posix() if page else None,
        explain=f"glassgait explain page --gait {gait.name} --policy {name}",
    )


def claims_by_verdict(certificate: Certificate) -> pd.DataFrame:
    """Returns a row a claim: its verdict, what it says, over which box, what was found."""
    rows = [
        {
            "verdict": OUTCOME_WORDS[verdict.outcome],
            "claim": verdict.claim.name,
            "over the": box_in_words(verdict.claim).removeprefix("over the "),
            "found": finding_in_words(verdict, steps=certificate.steps),
        }
        for outcome in OUTCOMES
        for verdict in certificate.verdicts
        if verdict.outcome == outcome
    ]
    return pd.DataFrame(rows, columns=["verdict", "claim", "over the", "found"])


def explanation_page(certificate: Certificate) -> Path | None:
    """Finds the page that explains the very policy of a certificate."""
    for config in sorted(Path("runs/explanation", certificate.gait).glob(f"*/{CONFIG}")):
        page = config.with_name("index.html")
        try:
            found = read_yaml(config)
        except InputError as error:
            say(f"left out: {error}")
            continue
        mine = isinstance(found, dict) and found.get(DIGEST) == certificate.policy_digest
        if mine and page.exists():
            return page
    return None
