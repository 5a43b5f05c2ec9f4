"""Certificates: the claims and bounds that were proved of a policy, as JSON that others can check.

Numbers are in the robot's units. The checker shares no code with this file.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.maximum import Maximum, Tree
from glassgait.models.certificates.prover import Outcome, Place, Prover, Verdict
from glassgait.models.certificates.targets import Query
from glassgait.models.files import digest
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.symmetry import mirrored_states

SHIPPED = Path(__file__).parent / "shipped"

OUTCOME_WORDS: dict[Outcome, str] = {"proved": "proved", "refuted": "refuted", "undecided": "open"}


def shipped_certificates() -> tuple[Path, ...]:
    """Lists the certificates that ship: those of the default robot, then of others by robot."""
    return tuple(sorted(SHIPPED.rglob("*.json"), key=lambda path: (len(path.parts), path)))


def certificate(prover: Prover, verdicts: Iterable[Verdict], policy_file: Path) -> dict[str, Any]:
    """Returns the certificate of a policy, from its prover, the decided claims and its file."""
    robot, gait, images = prover.policy.robot.name, prover.gait, mirrored_states(prover.gait)
    content = {
        "format": 2,
        **({} if robot == DEFAULT_ROBOT else {"robot": robot}),
        "gait": gait.name,
        "mirror": None if images is None else list(images),
        "policy": {"file": policy_file.name, "sha256": digest(policy_file)},
        "box": prover.boxes["operating"].ranges,
        "claims": [_verdict(verdict) for verdict in verdicts],
        "statements": [_statement(*own, prover.symbols) for own in prover.proofs.items()],
    }
    return {**content, "sha256": content_digest(content)}


def content_digest(content: dict[str, Any]) -> str:
    """Returns the SHA-256 of a certificate's content without its key "sha256"."""
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def certificate_text(content: dict[str, Any]) -> str:
    """Writes a certificate with one claim or statement on each line."""
    lines = []
    for key, value in content.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            inner = ",\n".join(f"  {json.dumps(one)}" for one in value)
            lines.append(f"{json.dumps(key)}: [\n{inner}\n]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """Returns a claim's keys that are given, and its outcome."""
    said = {own.name: getattr(verdict.claim, own.name) for own in fields(Claim)}
    said = {key: value for key, value in said.items() if value not in ((), None, {})}
    return said | {own.name: getattr(verdict, own.name) for own in fields(Verdict)[1:]}


def _statement(key: tuple[Query, Place], found: Maximum, symbols: Sequence[str]) -> dict[str, Any]:
    query, place = key
    written: dict[str, Any] = {"of": query.of, "state": query.state}
    written |= {"joint": quadruped.JOINTS[query.joint], "sign": query.sign}
    written |= {"box": place.box, "bound": found.bound}
    # Leave out what says nothing.
    if query.observation >= 0:
        written["observation"] = symbols[query.observation]
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
