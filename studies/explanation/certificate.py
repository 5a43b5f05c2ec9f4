"""A certificate beside a rollout: claims in words, witnesses as moments, steps outside of boxes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.certificate import (
    OUTCOME_WORDS,
    Certificate,
    box_in_words,
    claimed_joint,
    finding_in_words,
    shipped_certificates,
)
from glassgait.models.certificates.nearness import nearness, overruns
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.certificates.prover import Outcome, Verdict
from glassgait.models.certificates.question import Targets, targets_of
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.studies.explanation.policy_data import variables_of

MARKS: dict[Outcome, str] = {"proved": "✓", "refuted": "✗", "undecided": "○"}
"""Signs of what became of a claim, readable without colour."""


@dataclass(frozen=True)
class ClaimRow:
    """A claim, as the page shows it.

    Attributes:
        name: What it says.
        outcome: What became of it.
        verdict: The same in a word, behind its sign.
        over: Which observations it is about.
        finding: What was found.
        refuted_by: How many observations refute it.
    """

    name: str
    outcome: Outcome
    verdict: str
    over: str
    finding: str
    refuted_by: int


@dataclass(frozen=True)
class CertificatePanel:
    """What the page shows of a certificate.

    Attributes:
        file: The certificate's file.
        ships: Whether it ships.
        checked_by: The command that checks it.
        counts: Claims by what became of them.
        outside: At how many steps of the rollout the robot was outside of the boxes, in words.
        data: What the page computes with: `limits` of the joints (12, 2; rad); `outside`, of each
            step the observations that are outside of the operating box and by how much of the
            range's width, the furthest first; and `witnesses`, of each claim what refutes it, or
            None.
    """

    file: str
    ships: bool
    checked_by: str
    counts: Mapping[Outcome, int]
    rows: tuple[ClaimRow, ...]
    outside: str
    data: Mapping[str, Any]


def certificate_panel(
    certificate: Certificate, policy: Policy, policy_file: Path, observed: Array
) -> CertificatePanel:
    """Sets a certificate beside a rollout.

    Args:
        certificate: The policy's certificate.
        observed: What it observed (n_steps, n).
    """
    ships = certificate.path in shipped_certificates()
    own = "" if ships else f" {certificate.path} --policy {policy_file}"
    targets = targets_of(policy)
    beyond = overruns(certificate.boxes["operating"], observed)
    return CertificatePanel(
        file=certificate.path.name if ships else str(certificate.path),
        ships=ships,
        checked_by=f"glassgait verify check{own}",
        counts=certificate.counts(),
        rows=tuple(_row(verdict, certificate.steps) for verdict in certificate.verdicts),
        outside=" ".join(
            outside_in_words(name, overruns(box, observed), variables_of(policy, observed).titles)
            for name, box in certificate.boxes.items()
        ),
        data={
            "limits": np.transpose([policy.robot.lower_limits, policy.robot.upper_limits]).tolist(),
            "outside": [_furthest(own) for own in beyond],
            "witnesses": [
                _witness(verdict, certificate.boxes, targets, policy, observed)
                if verdict.witnesses
                else None
                for verdict in certificate.verdicts
            ],
        },
    )


def outside_in_words(box: str, beyond: Array, titles: tuple[str, ...]) -> str:
    """Counts at how many moments a robot was outside of a box.

    Args:
        beyond: By how much of its range's width each observation is outside (n_steps, n).
        titles: Names of the observations (n), and perhaps of more.
    """
    count, n_steps = np.count_nonzero(beyond.any(axis=-1)), len(beyond)
    if not count:
        return f"It is never outside of the {box} box."
    step, index = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    return (
        f"At {count} of {n_steps} steps ({100.0 * count / n_steps:.1f} %) it is "
        f"outside of the {box} box, furthest at step {step}, where {titles[index]} is beyond its "
        f"range by {beyond[step, index]:.2f} of the range's width."
    )


def _row(verdict: Verdict, steps: bool) -> ClaimRow:
    return ClaimRow(
        verdict.claim.name,
        verdict.outcome,
        f"{MARKS[verdict.outcome]} {OUTCOME_WORDS[verdict.outcome]}",
        box_in_words(verdict.claim),
        finding_in_words(verdict, steps=steps),
        len(verdict.witnesses),
    )


def _furthest(beyond: Array) -> list[list[float]]:
    order = np.argsort(-beyond, kind="stable")[: np.count_nonzero(beyond)]
    # JSON knows no infinity, which is the overrun of a range without width.
    finite = np.minimum(beyond[order], np.finfo(np.float32).max)
    return [[int(index), round(float(own), 3)] for index, own in zip(order, finite, strict=True)]


def _witness(
    verdict: Verdict,
    boxes: Mapping[str, ObservationBox],
    targets: Targets,
    policy: Policy,
    observed: Array,
) -> dict[str, Any]:
    """Returns a claim's witnesses in the page's own quantities, and how near each moment comes."""
    found = nearness(verdict, boxes, targets, observed)
    values, inputs = variables_of(policy, found.witnesses).values, found.inputs
    # Of formulas the page shows quantities, of other policies what they observe.
    scale = RobotUnits.of(policy.robot, policy.observation_names).scale
    widths = found.widths / scale if isinstance(policy, FormulaPolicy) else found.widths
    return {
        "claim": verdict.claim.name,
        "joint": claimed_joint(verdict),
        "state": found.state,
        "inputs": inputs.tolist(),
        "widths": widths[inputs].tolist(),
        "values": np.round(values[:, inputs], 5).tolist(),
        "targets": np.round(policy.robot.joint_targets(policy(found.witnesses)), 5).tolist(),
        "distances": [
            round(own, 3) if np.isfinite(own) else None for own in found.distances.tolist()
        ],
        "nearest": found.nearest,
        "diagonal": found.diagonal,
    }
