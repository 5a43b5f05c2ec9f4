"""What is certified of the gaits' policies: claims by verdict, and where each is explained."""

import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import pandas as pd

from glassgait.models.certificates.certificate import (
    OUTCOME_WORDS,
    Certificate,
    box_in_words,
    finding_in_words,
)
from glassgait.models.certificates.prover import OUTCOMES
from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import say
from glassgait.studies.common.run_folder import default_folder
from glassgait.studies.distillation.students.library import certificates_of
from glassgait.studies.distillation.students.registry import STUDENTS, policy_title
from glassgait.studies.explanation.command import CONFIG, DIGEST
from glassgait.studies.reproduction.page import Section, Table

NOTE = (
    "A claim is about every observation between a least and a greatest value of each, whatever the "
    "robot does. Refuted is what an observation breaks; it was calculated, and no robot need ever "
    "meet it. A certificate is of one policy file: students that were distilled for this report "
    "are other policies, which `glassgait verify prove` certifies."
)


def certificates(gaits: Sequence[str], robot: Robot, folder: Path) -> Section:
    """Lists the policies of gaits that have a certificate, made here or shipped.

    Returns:
        Of such policies a table of how many claims have which verdict, and then one of each
        policy: the claims that are proved, then refuted, then open.
    """
    policies = [
        _claims_of(certificate, robot, folder)
        for gait in map(load_gait, gaits)
        for certificate in certificates_of(gait, robot)
    ]
    verdicts = pd.DataFrame(
        {"policy": own.heading}
        | {
            OUTCOME_WORDS[outcome]: int((own.frame["verdict"] == OUTCOME_WORDS[outcome]).sum())
            for outcome in OUTCOMES
        }
        for own in policies
    )
    return Section(
        "Certificates: what policies can never do",
        note=NOTE if policies else f"{NOTE} No policy of these gaits has one.",
        tables=[Table(verdicts), *policies] if policies else [],
    )


def _claims_of(certificate: Certificate, robot: Robot, folder: Path) -> Table:
    stem = Path(certificate.policy_file).stem
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
    page = explanation_page(certificate, robot)
    if page is None:
        name = stem if stem in STUDENTS else certificate.policy_file
        command = f"glassgait explain page --gait {certificate.gait} --policy {name}"
        note = f"`{command}` writes the page that shows the witnesses beside a rollout."
    else:
        link = f"{quote(Path(os.path.relpath(page, folder)).as_posix())}#certificate"
        note = f"[Its explanation page]({link}) shows the witnesses beside a rollout."
    columns = pd.Index(["verdict", "claim", "over the", "found"])
    title = f"{certificate.gait.capitalize()}: {policy_title(stem)}"
    return Table(pd.DataFrame(rows, columns=columns), title, note)


def explanation_page(certificate: Certificate, robot: Robot) -> Path | None:
    """Finds the page that explains the very policy of a certificate."""
    pages = default_folder("explain page", robot.name) / certificate.gait
    for config in sorted(pages.glob(f"*/{CONFIG}")):
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
