"""Certificates: all that was proved of a policy, as JSON that others can check by themselves.

Numbers are in the robot's units. The checker's own reading defines what each key means: it shares
nothing with what is written and read here.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.prover import Outcome, Prover, Verdict
from glassgait.models.certificates.question import Statement, Tree
from glassgait.models.files import RECORD_BYTES, digest, read_text
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.symmetry import mirrored_states

FORMAT = 1

SHIPPED = Path(__file__).parent / "shipped"

_CLAIM_KEYS = tuple(own.name for own in fields(Claim))
_FOUND_KEYS = tuple(own.name for own in fields(Verdict) if own.name != "claim")


def shipped_certificates() -> tuple[Path, ...]:
    """Lists the certificates that ship: those of the default robot, then of others by robot."""
    return tuple(sorted(SHIPPED.rglob("*.json"), key=lambda path: (len(path.parts), path)))


def certificate(prover: Prover, verdicts: Iterable[Verdict], policy_file: Path) -> dict[str, Any]:
    """Returns the certificate of a policy.

    Args:
        prover: The prover, with all that it proved.
        verdicts: The claims that were decided.
        policy_file: The policy's file, whose every byte counts.
    """
    robot = prover.policy.robot.name
    gait, images = prover.gait, mirrored_states(prover.gait)
    content = {
        "format": FORMAT,
        **({} if robot == DEFAULT_ROBOT else {"robot": robot}),
        "gait": gait.name,
        "states": list(gait.states),
        "mirror": None if images is None else list(images),
        "policy": {
            "kind": prover.policy.kind,
            "file": policy_file.name,
            "sha256": digest(policy_file),
        },
        "boxes": {
            name: _ranges(prover.symbols, box.quantities) for name, box in prover.boxes.items()
        },
        "claims": [_verdict(verdict) for verdict in verdicts],
        "statements": [_statement(own, prover) for own in prover.proofs.values()],
    }
    return {**content, "sha256": content_digest(content)}


def content_digest(content: dict[str, Any]) -> str:
    """Returns the SHA-256 of a certificate's content, its own key "sha256" left out."""
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def certificate_text(content: dict[str, Any]) -> str:
    """Writes a certificate, a claim and a statement a line."""
    lines = []
    for key, value in content.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            inner = ",\n".join(f"  {json.dumps(one)}" for one in value)
            lines.append(f"{json.dumps(key)}: [\n{inner}\n]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _ranges(symbols: Sequence[str], corners: tuple[Any, Any]) -> dict[str, list[float]]:
    ends = np.transpose(corners).tolist()
    return dict(zip(symbols, ends, strict=True))


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """Writes a claim, without the keys that it leaves out, and what became of it."""
    said = {key: getattr(verdict.claim, key) for key in _CLAIM_KEYS}
    said = {key: value for key, value in said.items() if value not in ((), None, {})}
    return said | {key: getattr(verdict, key) for key in _FOUND_KEYS}


def _statement(statement: Statement, prover: Prover) -> dict[str, Any]:
    question, place, found = statement.question, statement.place, statement.found
    symbols = prover.symbols
    written: dict[str, Any] = {
        "of": question.of,
        "state": question.state,
        "joint": quadruped.JOINTS[question.joint],
        "sign": question.sign,
        "box": place.box,
        "bound": statement.bound,
    }
    if question.observation is not None:
        written["observation"] = symbols[question.observation]
    if place.stuck:
        written["stuck"] = [symbols[index] for index in place.stuck]
    if found.splits:
        written["splits"] = _splits(found.splits, [*symbols, "other"])
    return written


def _splits(tree: Tree, symbols: Sequence[str]) -> list[Any]:
    if not tree:
        return []
    index, cut, below, above = tree
    return [symbols[index], cut, _splits(below, symbols), _splits(above, symbols)]


OUTCOME_WORDS: dict[Outcome, str] = {"proved": "proved", "refuted": "refuted", "undecided": "open"}


def shipped_outcomes(policy_digest: str) -> dict[str, Outcome] | None:
    """Returns the outcome of each claim that a shipped certificate names, by the claim's name.

    Args:
        policy_digest: SHA-256 of the policy's file.

    Returns:
        The outcomes; None if no certificate of this file ships.
    """
    for path in shipped_certificates():
        content = json.loads(read_text(path, RECORD_BYTES))
        if content["policy"]["sha256"] == policy_digest:
            return {claim["name"]: claim["outcome"] for claim in content["claims"]}
    return None
