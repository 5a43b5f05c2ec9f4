"""Certificates: decided claims about a policy, as JSON that a second program can check.

Numbers are in the robot's units. The checker shares no code with this file.
"""

import hashlib
import json
import re
from collections.abc import Iterable
from dataclasses import field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from glassgait.models.certificates.box import ObservationBox, operating_box, physical_box
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.prover import Outcome, Prover, Verdict
from glassgait.models.errors import InputError, shown
from glassgait.models.files import digest, read_text
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.library import load_robot, robot_folder
from glassgait.models.settings import Range, Settings, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.symmetry import mirrored_states

if TYPE_CHECKING:
    from glassgait.models.certificates.checker import Decision

SHIPPED = Path(__file__).parent / "shipped"

OUTCOME_WORDS: dict[str, str] = {"proved": "proved", "refuted": "refuted", "undecided": "open"}


@checked
class _Decided(Claim):
    outcome: Outcome = "undecided"
    splits: dict[str, list[Any]] = field(default_factory=dict)
    witnesses: tuple[dict[str, float], ...] = ()


@checked
class _Certificate(Settings):
    title: ClassVar[str] = "certificate"

    format: Literal[3]
    policy: dict[Literal["file", "sha256"], str]
    gait: str
    robot: str
    numbers: dict[str, float]
    mirror: tuple[int, ...] | None
    operating: dict[str, Range]
    physical: dict[str, Range]
    claims: tuple[_Decided, ...]
    sha256: str


def shipped_certificates() -> tuple[Path, ...]:
    """Lists the shipped certificates: the default robot's first, then those of each other robot."""
    return tuple(sorted(SHIPPED.rglob("*.json"), key=lambda path: (len(path.parts), path)))


def certificate(prover: Prover, verdicts: Iterable[Verdict], policy_file: Path) -> dict[str, Any]:
    """Returns the certificate of a policy, from its prover, the decided claims and its file."""
    content = {
        "format": 3,
        "policy": {"file": policy_file.name, "sha256": digest(policy_file)},
        **assumptions(prover.policy, prover.gait, prover.boxes["operating"]),
        "claims": [_verdict(verdict) for verdict in verdicts],
    }
    return {**content, "sha256": content_digest(content)}


def assumptions(policy: Policy, gait: Gait, operating: ObservationBox) -> dict[str, Any]:
    """Returns a certificate's assumptions about the robot, the machine and the boxes."""
    robot, images = policy.robot, mirrored_states(gait)
    stiffness, damping = policy.joint_law.worst_gains(robot)
    numbers = {"torque": float(robot.effort.min()), "stiffness": stiffness, "damping": damping}
    return {
        "gait": gait.name,
        "robot": robot.name,
        "numbers": {**numbers, "action_scale": robot.action_scale},
        "mirror": None if images is None else list(images),
        "operating": operating.ranges,
        "physical": physical_box(gait, operating).ranges,
    }


def check_certificate(path: Path, policy: Path | None = None, robot: Path | None = None) -> str:
    """Checks a certificate and its assumptions; returns a report with one line for each claim.

    By default, policy and robot are the shipped ones that the certificate names.
    """
    # Imported here, because no other command needs python-flint.
    try:
        from glassgait.models.certificates.checker import RefusedError, check  # noqa: PLC0415
    except ImportError as error:
        raise InputError(
            "checking needs python-flint; install it with pip install 'glassgait[certify]'"
        ) from error

    # Find the policy, and read it as robots do.
    try:
        content = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{path}: is no certificate; 'glassgait verify prove' writes one"
        ) from error
    loaded = _Certificate.from_plain(content, str(path))
    names = loaded.robot, loaded.gait, loaded.policy["file"]
    if policy is None and re.fullmatch(r"\w+/\w+/\w+\.formulas", "/".join(names)):
        policy = robot_folder(STUDENT_DIRECTORY, names[0]) / names[1] / names[2]
    if policy is None or not policy.exists():
        raise InputError(f"{path}: no policy {shown(names[2])} ships; name its file by --policy")
    read = load_policy(policy, load_robot(robot) if robot else None)
    if not isinstance(read, FormulaPolicy) or read.machine is None:
        raise InputError(f"{policy}: holds no formulas, or no machine; name the certified file")

    # Its content must be intact, its claims valid, and its assumptions true.
    if content_digest(content) != loaded.sha256:
        raise InputError(f"{path}: was changed, its digest does not match; prove anew")
    for claim in loaded.claims:
        claim.refuse_unknown(read.machine, imu=read.layout.imu)
    box = ObservationBox.of_ranges(read.robot, read.observation_names, loaded.operating)
    for key, value in assumptions(read, read.machine, box).items():
        if content[key] != value:
            raise InputError(f"{path}: key {key!r} does not fit {policy} and its robot; prove anew")

    # Decide the claims.
    try:
        decisions = check(path, policy)
    except RefusedError as error:
        raise InputError(f"{path}: {error}") from error
    outcomes = [decision.outcome for decision in decisions]
    counts = ", ".join(f"{outcomes.count(key)} {word}" for key, word in OUTCOME_WORDS.items())
    try:
        ships = operating_box(read.machine, read.robot).ranges == box.ranges
    except InputError:
        ships = False
    trusted = "is the one that ships" if ships else "is taken on trust"
    return "\n  ".join([f"{counts}; its operating box {trusted}", *map(_described, decisions)])


def _described(decision: "Decision") -> str:
    """Returns a decided claim in a line: a shipped one by name, another with its whole content."""
    claim = decision.claim
    details = {key: claim[key] for key in claim if decision.foreign and key != "name"}
    if claim["kind"] != "mirror":
        details["most"] = f"{decision.most:g}"
    words = ["not a claim that ships"] if decision.foreign else []
    words += [f"{key} {json.dumps(value)}".replace('"', "") for key, value in details.items()]
    suffix = f" ({', '.join(words)})" if words else ""
    return f"{OUTCOME_WORDS[decision.outcome]}: {claim['name']}{suffix}"


def content_digest(content: dict[str, Any]) -> str:
    """Returns the SHA-256 of a certificate's content without its key "sha256"."""
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def certificate_text(content: dict[str, Any]) -> str:
    """Writes a certificate with one claim on each line."""
    lines = []
    for key, value in content.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            inner = ",\n".join(f"  {json.dumps(item)}" for item in value)
            lines.append(f"{json.dumps(key)}: [\n{inner}\n]")
        else:
            lines.append(f"{json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """Returns a claim's content, its outcome, and the splits or witnesses that show it."""
    defaults = {key.name: key.default for key in fields(Claim)} | {"changes": {}}
    claim = {name: getattr(verdict.claim, name) for name in defaults}
    claim = {name: value for name, value in claim.items() if value != defaults[name]}
    proof = {"splits": verdict.splits, "witnesses": verdict.witnesses}
    return claim | {"outcome": verdict.outcome} | {key: proof[key] for key in proof if proof[key]}
