"""What became of a claim, in words."""

import math

from glassgait.models.certificates.claims import Claim, ClaimKind
from glassgait.models.certificates.prover import Outcome, Verdict
from glassgait.models.robots import quadruped
from glassgait.models.task.gait_keys import MOST_STATES
from glassgait.models.task.observation import ObservationLayout

OUTCOME_WORDS: dict[Outcome, str] = {"proved": "proved", "refuted": "refuted", "undecided": "open"}

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
    """Tells which observations a claim is about."""
    stuck = f", {', '.join(claim.stuck)} anywhere in the physical box" if claim.stuck else ""
    return f"over the {claim.box} box{stuck}"


def finding_in_words(verdict: Verdict, *, steps: bool = False) -> str:
    """Tells what was found of a claim: what breaks it, or how far it is from being broken.

    What is proved is rounded outward, and what a witness reaches inward.

    Args:
        verdict: The claim, and what became of it.
        steps: Whether targets are of tables or trees, whose slopes are the greatest steps.
    """
    place, by = _place_in_words(verdict)
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
    if verdict.claim.kind != "never":
        return _BOUNDED[verdict.claim.kind]
    if steps:
        return "step", " rad"
    units = {entry.symbol: entry.unit for entry in ObservationLayout(MOST_STATES).entries}
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
