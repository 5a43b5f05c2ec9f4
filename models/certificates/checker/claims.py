"""What a claim may say; each key is refused where it is of no use, misspelt or of another kind."""

import re
from typing import Any

from .robot import COUNTED, JOINTS, is_number, refuse_unless

OUTCOMES = ("proved", "refuted", "undecided")
BOXES = ("operating", "physical")
WRITTEN = ("name", "kind", "outcome", "worst", "claimed", "where", "witnesses")
"""What every claim says."""

SCOPE = ("joints", "states", "box")
"""What any claim may say."""

NEEDED = {
    "limits": (),
    "torque": (),
    "never": ("observations", "never"),
    "effect": ("observations", "most"),
    "independent": ("observations",),
    "mirror": (),
    "change": ("changes",),
}
ALLOWED = {
    "limits": ("least", "most", "stuck"),
    "torque": ("most", "stuck"),
    "never": ("most", "stuck"),
    "effect": ("stuck",),
    "independent": (),
    "mirror": (),
    "change": ("most",),
}


def is_list_of(value: Any, known: list[str]) -> bool:
    """Returns whether a value lists known names, none of them twice."""
    return (
        isinstance(value, list)
        and all(isinstance(own, str) and own in known for own in value)
        and len({*value}) == len(value)
    )


def check_keys(claim: Any, states: list[str], names: list[str]) -> None:
    """Refuses a claim that is not one.

    Args:
        claim: The claim.
        states: Names of the machine's states.
        names: The quantities, without the machine's states: of these nothing can be claimed, since
            each state is decided by itself.
    """
    refuse_unless(isinstance(claim, dict), "a claim is no mapping")
    name, kind = repr(claim.get("name"))[:60], claim.get("kind")
    refuse_unless(kind in NEEDED, f"{name}: a claim of kind {kind!r} is not known")
    needed = {*WRITTEN, *NEEDED[kind]}
    known = {*needed, *SCOPE, *ALLOWED[kind]}
    refuse_unless(needed <= {*claim}, f"{name}: lacks the keys {sorted(needed - {*claim})}")
    unsigned = kind in ("limits",) or claim.get("most", 0.0) >= 0.0
    refuse_unless(unsigned, f"{name}: its 'most' is below 0")
    counted = kind == "never" and {*claim["observations"]} & {*COUNTED}
    refuse_unless(not counted, f"{name}: counts of steps have no slope; claim an effect")
    refuse_unless({*claim} <= known, f"{name}: has keys of no use, {sorted({*claim} - known)}")
    own = [*names, *(f"{kind}.own" for kind in ("q", "dq", "a"))]
    kinds = {name.partition(".")[0] for name in names} - {"cmd"}
    sound = {
        "name": lambda value: isinstance(value, str) and value,
        "kind": lambda value: True,
        "outcome": lambda value: value in OUTCOMES,
        "worst": is_number,
        "claimed": is_number,
        "where": lambda value: isinstance(value, str),
        "witnesses": lambda value: isinstance(value, list) and all(map(is_point, value)),
        "joints": lambda value: is_list_of(value, JOINTS),
        "states": lambda value: is_list_of(value, states),
        "box": lambda value: value in BOXES,
        "stuck": lambda value: is_list_of(value, names),
        "observations": lambda value: value and is_list_of(value, own),
        "never": lambda value: value in ("rises", "falls"),
        "least": is_number,
        "most": is_number,
        "changes": lambda value: (
            isinstance(value, dict)
            and value
            and {*value} <= {*names, *kinds}
            and all(is_number(most) and most >= 0.0 for most in value.values())
        ),
    }
    for key, value in claim.items():
        refuse_unless(sound[key](value), f"{name}: its {key!r} is not what it must be")


def is_point(value: Any) -> bool:
    return isinstance(value, dict) and all(map(is_number, value.values()))


def observations(claim: dict[str, Any], joint: str) -> list[str]:
    """Names the quantities that a claim is of, for a joint."""
    return [re.sub(r"\.own$", f".{joint}", name) for name in claim["observations"]]
