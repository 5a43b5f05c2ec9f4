"""Certificates: all that was proved of a policy, as JSON that others can check by themselves.

Numbers are in the robot's units. The checker's own reading defines what each key means: it shares
nothing with what is written here.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from glassgait.models.certificates.maximum import Tree
from glassgait.models.certificates.prover import Prover, Verdict
from glassgait.models.certificates.question import Statement
from glassgait.models.files import digest
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.observation import indices_of
from glassgait.models.task.symmetry import mirrored_states

FORMAT = 1

SHIPPED = Path(__file__).parent / "shipped"


def shipped_certificates() -> tuple[Path, ...]:
    """Lists the certificates that ship with the project."""
    return tuple(sorted(SHIPPED.glob("*.json")))


def certificate(prover: Prover, verdicts: Iterable[Verdict], policy_file: Path) -> dict[str, Any]:
    """Returns the certificate of a policy.

    Args:
        prover: The prover, with all its statements.
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
        "statements": [_statement(own, prover) for own in prover.statements.values()],
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
    low, high = corners
    return {
        symbol: [a, b] for symbol, a, b in zip(symbols, low.tolist(), high.tolist(), strict=True)
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    claim = verdict.claim
    said = {own.name: getattr(claim, own.name) for own in fields(claim)}
    return {
        **{key: value for key, value in said.items() if value not in ((), None, {})},
        "outcome": verdict.outcome,
        "worst": verdict.worst,
        "claimed": verdict.claimed,
        "where": verdict.where,
        "witnesses": list(verdict.witnesses),
    }


def _statement(statement: Statement, prover: Prover) -> dict[str, Any]:
    question, place, found = statement.question, statement.place, statement.found
    symbols = prover.symbols
    region = prover.region(place, question.state)
    written: dict[str, Any] = {
        "of": question.of,
        "state": question.state,
        "joint": quadruped.JOINTS[question.joint],
        "sign": question.sign,
        "box": place.box,
        "bound": statement.bound,
        "reached": found.reached,
    }
    if question.observation is not None:
        written["observation"] = symbols[question.observation]
    if place.stuck:
        written["stuck"] = [symbols[index] for index in place.stuck]
    positions = indices_of("joint position", prover.policy.observation_names)
    used = prover.targets.used(question.state, question.joint)
    written["witness"] = {
        symbols[index]: float(found.witness[index])
        for index in sorted(used | _asked(statement, positions))
        if region.lower[index] < region.upper[index]
    }
    if len(found.witness) > len(symbols):
        written["other"] = float(found.witness[-1])
    if found.splits:
        written["splits"] = _splits(found.splits, [*symbols, "other"])
    return written


def _asked(statement: Statement, positions: Sequence[int]) -> frozenset[int]:
    """Returns the observations that a question itself names: the joint's own angle, for one."""
    question = statement.question
    own = {question.observation} if question.observation is not None else set()
    return frozenset(own | ({positions[question.joint]} if question.of == "offset" else set()))


def _splits(tree: Tree, symbols: Sequence[str]) -> list[Any]:
    if not tree:
        return []
    index, cut, below, above = tree
    return [symbols[index], cut, _splits(below, symbols), _splits(above, symbols)]
