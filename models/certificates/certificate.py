"""Certificates: all that was proved of a policy, as JSON that others can check by themselves.

Numbers are in the robot's units. The checker's own reading defines what each key means: it shares
nothing with what is written and read here.
"""

import hashlib
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.models.certificates.claims import Claim, ClaimKind, Kept
from glassgait.models.certificates.observation_box import ObservationBox
from glassgait.models.certificates.prover import OUTCOMES, Outcome, Prover, Verdict
from glassgait.models.certificates.question import Statement, Tree
from glassgait.models.errors import InputError
from glassgait.models.files import RECORD_BYTES, digest, read_text
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import robot_of
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_keys import MOST_STATES
from glassgait.models.task.observation import ObservationLayout
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


@dataclass(frozen=True)
class Certificate:
    """What a certificate says. Whether it holds, the checker alone decides.

    Attributes:
        path: Its file.
        robot: Name of the robot.
        gait: Name of the gait.
        states: Names of the machine's states.
        policy_kind: Kind of the policy.
        policy_file: Name of the policy's file.
        policy_digest: SHA-256 of that file.
        boxes: The boxes by name, "operating" and "physical".
        verdicts: What became of each claim, in order.
    """

    path: Path
    robot: str
    gait: str
    states: tuple[str, ...]
    policy_kind: str
    policy_file: str
    policy_digest: str
    boxes: Mapping[str, ObservationBox]
    verdicts: tuple[Verdict, ...]

    @property
    def steps(self) -> bool:
        """Whether the policy's targets are of tables or trees, which have steps and no slopes."""
        return self.policy_kind in (AdditivePolicy.kind, BoostedTreesPolicy.kind)

    def counts(self) -> dict[Outcome, int]:
        """Counts the claims by what became of them."""
        outcomes = [verdict.outcome for verdict in self.verdicts]
        return {outcome: outcomes.count(outcome) for outcome in OUTCOMES}

    def is_of(self, gait: Gait, policy_digest: str) -> bool:
        """Returns whether it is of a policy, by the digest of its file, in a gait."""
        own = self.gait, self.states, self.policy_digest
        return own == (gait.name, gait.states, policy_digest)


def read_certificate(path: Path, robot: Robot | None = None) -> Certificate:
    """Reads a certificate, without checking what it says.

    Args:
        path: Its file.
        robot: The robot that it has to be of; by default the one that ships which it names.

    Raises:
        InputError: if the file cannot be read, is damaged or is no certificate.
    """
    text = read_text(path, RECORD_BYTES)
    try:
        content = json.loads(text)
        sound = content["sha256"] == content_digest(content) and content["format"] == FORMAT
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"{path}: is no certificate; make one with 'glassgait verify prove'"
        ) from error
    if not sound:
        raise InputError(f"{path}: is damaged, its digest is of other contents; certify anew")
    try:
        robot = robot_of(path, content.get("robot"), robot)
        imu = "g.x" in content["boxes"]["operating"]
        layout = ObservationLayout(len(content["states"]), imu=imu)
        symbols = [entry.symbol for entry in layout.entries]
        return Certificate(
            path,
            robot.name,
            str(content["gait"]),
            tuple(map(str, content["states"])),
            str(content["policy"]["kind"]),
            str(content["policy"]["file"]),
            str(content["policy"]["sha256"]),
            {
                name: ObservationBox.of_quantities(robot, layout.names, content["boxes"][name])
                for name in ("operating", "physical")
            },
            tuple(_read_verdict(claim, symbols) for claim in content["claims"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, InputError) as error:
        raise InputError(f"{path}: is no certificate of this version ({error})") from error


def _read_verdict(written: dict[str, Any], symbols: Sequence[str]) -> Verdict:
    said = {key: value for key, value in written.items() if key in _CLAIM_KEYS}
    found = {key: written[key] for key in _FOUND_KEYS}
    verdict = Verdict.from_plain({"claim": said, **found}, "a claim")
    if any({*witness} != {*symbols} for witness in verdict.witnesses):
        raise ValueError("a witness has other observations than the gait has")
    return verdict


OUTCOME_WORDS: dict[Outcome, str] = {"proved": "proved", "refuted": "refuted", "undecided": "open"}

_KEPT: dict[Kept | None, tuple[str, str]] = {
    "range": ("target", " rad"),
    "rate": ("change of the target in a step", " rad"),
    "torque": ("torque at rest", " N·m"),
    "finite": ("change of the target", " rad"),
    "lean": ("lean at which the policy acts", "°"),
}
"""What limits keep, and its unit."""

_BOUNDED: dict[ClaimKind, tuple[str, str]] = {
    "limits": ("target", " rad"),
    "torque": ("torque at rest", " N·m"),
    "effect": ("change of the target", " rad"),
    "independent": ("change of the target", " rad"),
    "mirror": ("difference of left and right", " rad"),
    "change": ("squared change of the action", ""),
}
"""What a claim of each kind bounds, and its unit."""

ROUNDING = 1e-8
"""What rounding passes over: bounds hold an allowance for double precision, which is a tenth."""


def claimed_joint(verdict: Verdict) -> int | None:
    """Returns the joint that the worst case is of; None where it is of none alone."""
    first = verdict.where.split(",")[0].split(" ")[0]
    return quadruped.JOINTS.index(first) if first in quadruped.JOINTS else None


def box_in_words(claim: Claim) -> str:
    """Returns which observations a claim is about."""
    if claim.kind == "kept":
        return "whatever the policy asks for"
    stuck = f", {', '.join(claim.stuck)} anywhere in the physical box" if claim.stuck else ""
    return f"over the {claim.box} box{stuck}"


def finding_in_words(verdict: Verdict, *, steps: bool = False) -> str:
    """Describes what was found of a claim: what breaks it, or how far it is from being broken.

    What is proved is rounded outward, and what a witness reaches inward.

    Args:
        verdict: The claim, and what became of it.
        steps: Whether targets are of tables or trees, whose slopes are the greatest steps.
    """
    place, by = _place_in_words(verdict)
    if verdict.outcome == "proved" and verdict.claim.keeps == "finite":
        return "The last of its limits sees to it."
    if verdict.outcome == "proved" and not place:
        return f"{verdict.where[0].upper()}{verdict.where[1:]}."
    noun, unit = _noun_and_unit(verdict, steps)
    # What is proved lies on this side of what is claimed; all else lies beyond.
    most = (verdict.worst > verdict.claimed) != (verdict.outcome == "proved")
    side = "at most" if most else "at least"
    worst = _rounded(verdict.worst, up=most != (verdict.outcome == "refuted")) + unit
    claimed = f"{side} {_number(verdict.claimed)}{unit if verdict.claimed else ''} is claimed"
    match verdict.outcome:
        case "refuted":
            return f"{place[0].upper()}{place[1:]}: {noun} of {worst}{by}, where {claimed}."
        case "proved":
            return f"Closest is {place}: {noun} always {side} {worst}{by}, where {claimed}."
        case "undecided":
            return (
                f"{noun.capitalize()} proved to be {side} {worst} only; {claimed}, and nothing "
                "found breaks it."
            )


def _noun_and_unit(verdict: Verdict, steps: bool) -> tuple[str, str]:
    if verdict.claim.kind == "kept":
        return _KEPT[verdict.claim.keeps]
    if verdict.claim.kind != "never":
        return _BOUNDED[verdict.claim.kind]
    if steps:
        return "step", " rad"
    units = {entry.symbol: entry.unit for entry in ObservationLayout(MOST_STATES, imu=True).entries}
    unit = units.get(verdict.where.rpartition(", ")[2], "unit")
    return "slope", f" rad/{unit}" if unit.isalpha() else f" rad/({unit})"


def _place_in_words(verdict: Verdict) -> tuple[str, str]:
    """Returns joint and state of the worst case, if it is of any, and by which observation."""
    if claimed_joint(verdict) is None:
        return verdict.where if verdict.claim.kind == "change" else "", ""
    joint, *rest = verdict.where.replace("_", " ", 1).split(", ")
    state, *observation = rest or [""]
    return f"{joint} in {state}" if state else joint, f" by {observation[0]}" if observation else ""


def _rounded(value: float, *, up: bool) -> str:
    """Writes four digits of a number, rounded up or down."""
    if abs(value) < ROUNDING:
        return "0"
    step = 10.0 ** (math.floor(math.log10(abs(value))) - 3)
    whole = math.ceil((value - ROUNDING) / step) if up else math.floor((value + ROUNDING) / step)
    return _number(whole * step)


def _number(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")
