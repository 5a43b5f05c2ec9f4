"""The keys of a gait's YAML file, and what each must be."""

from typing import Any

from glassgait.models.errors import InputError, shown
from glassgait.models.plain_yaml import parse_yaml
from glassgait.models.task.formula import N_STANCES, parse_formula

LONGEST_STATE = 40
"""Greatest number of characters of a state's name."""

LONGEST_DESCRIPTION = 500
"""Greatest number of characters of a description."""

MOST_STATES = 32
"""Greatest number of states; each is an entry of the observation."""

GREATEST_DWELL = 1000
"""Greatest commanded number of iterations in a state (control steps)."""

GREATEST_GRACE = 100_000
"""Greatest grace of a transition (control steps)."""

_GREATEST = {"clearance": 1.0, "max_speed": 100.0, "max_yaw_rate": 100.0}

_KEYS = {
    "description": str,
    "states": list,
    "initial": str,
    "transitions": list,
    "clearance": (int, float),
    "dwell": list,
    "max_speed": (int, float),
    "max_yaw_rate": (int, float),
}
_OPTIONAL_KEYS = {"faults": list}
_TRANSITION_KEYS = {"from", "to", "when"}
_OPTIONAL_TRANSITION_KEYS = {"dwell", "grace"}


def checked_values(text: str) -> dict[str, Any]:
    """Reads YAML text to the attributes of a gait, name left out; a transition's are a mapping.

    Raises:
        InputError: if a key is missing, unknown, of the wrong kind or out of range, or a formula
            is unknown.
    """
    data = _checked_keys(parse_yaml(text))
    return {
        "description": _description(data["description"]),
        "states": _state_names(data["states"]),
        "initial": data["initial"],
        "faults": _fault_names(data.get("faults", [])),
        "transitions": _transitions(data["transitions"]),
        "clearance": _positive(data, "clearance"),
        "dwell": _dwell_range(data["dwell"]),
        "max_speed": _positive(data, "max_speed"),
        "max_yaw_rate": _positive(data, "max_yaw_rate"),
    }


def is_plain(name: str, longest: int) -> bool:
    """Returns whether a name is printable, of 1 to `longest` characters, no space at its ends."""
    return 0 < len(name) <= longest and name.isprintable() and name == name.strip()


def _checked_keys(data: Any) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise InputError("is not a mapping; start from one of the shipped gait files")
    known = _KEYS | _OPTIONAL_KEYS
    for key in data:
        if key not in known:
            raise InputError(f"unknown key {shown(key)}; the keys are {', '.join(known)}")
    for key, kind in _KEYS.items():
        if key not in data:
            raise InputError(f"missing key {key!r}; add it")
        _check_kind(data, key, kind)
    for key, kind in _OPTIONAL_KEYS.items():
        if key in data:
            _check_kind(data, key, kind)
    return data


def _check_kind(data: dict[str, Any], key: str, kind: Any) -> None:
    if not isinstance(data[key], kind) or isinstance(data[key], bool):
        wanted = {str: "text", list: "a list"}.get(kind, "a number such as 0.03 or 3.0e-2")
        raise InputError(f"key {key!r} must be {wanted}, not {shown(data[key])}")


def _positive(data: dict[str, Any], key: str) -> float:
    value, greatest = data[key], _GREATEST[key]
    if not 0 < value <= greatest:
        raise InputError(
            f"key {key!r} is {shown(value)}; it must be greater than 0 and at most {greatest:g}"
        )
    return float(value)


def _description(text: str) -> str:
    line = " ".join(text.split())
    if len(line) > LONGEST_DESCRIPTION or not line.isprintable():
        raise InputError(
            f"key 'description' is {shown(line)}; write printable characters, "
            f"{LONGEST_DESCRIPTION} at most"
        )
    return line


def _state_names(states: list[Any]) -> tuple[str, ...]:
    for state in states:
        if not isinstance(state, str):
            raise InputError(f"key 'states' holds {shown(state)}; states are named by text")
        if not is_plain(state, LONGEST_STATE):
            raise InputError(
                f"key 'states' holds {shown(state)}; name states by printable characters, "
                f"{LONGEST_STATE} at most, with no space at the ends"
            )
    if not 2 <= len(states) <= MOST_STATES or len(set(states)) != len(states):
        raise InputError(
            f"key 'states' must name at least two different states, and {MOST_STATES} at most"
        )
    return tuple(states)


def _fault_names(states: list[Any]) -> tuple[str, ...]:
    if not all(isinstance(state, str) for state in states) or len(set(states)) != len(states):
        raise InputError(f"key 'faults' is {shown(states)}; list different states by their names")
    return tuple(states)


def _dwell_range(dwell: list[Any]) -> tuple[int, int]:
    whole = all(isinstance(value, int) and not isinstance(value, bool) for value in dwell)
    if not (whole and len(dwell) == 2 and 1 <= dwell[0] <= dwell[1] <= GREATEST_DWELL):
        raise InputError(
            f"key 'dwell' is {shown(dwell)}; give the least and greatest, such as [6, 11], "
            f"{GREATEST_DWELL} at most"
        )
    return dwell[0], dwell[1]


def _transitions(entries: list[Any]) -> list[dict[str, Any]]:
    most = MOST_STATES * N_STANCES
    if len(entries) > most:
        raise InputError(f"key 'transitions' holds {len(entries)}; {most} are the most")
    return [_transition(entry, i) for i, entry in enumerate(entries)]


def _transition(entry: Any, index: int) -> dict[str, Any]:
    where = f"transitions[{index}]"
    if not isinstance(entry, dict):
        raise InputError(f"{where} is not a mapping; write {{from: q0, to: q1, when: FL & RR}}")
    known = _TRANSITION_KEYS | _OPTIONAL_TRANSITION_KEYS
    for key in entry:
        if key not in known:
            raise InputError(f"{where}: unknown key {shown(key)}; the keys are {sorted(known)}")
    for key in sorted(_TRANSITION_KEYS):
        if key not in entry:
            raise InputError(f"{where}: missing key {key!r}; add it")
        if not isinstance(entry[key], str):
            raise InputError(f"{where}: key {key!r} must be text, not {shown(entry[key])}")
    dwell, grace = entry.get("dwell", 1.0), entry.get("grace", 0)
    if isinstance(dwell, bool) or not isinstance(dwell, (int, float)) or not 0 <= dwell <= 1:
        raise InputError(f"{where}: key 'dwell' is {shown(dwell)}; it is a fraction from 0 to 1")
    whole = isinstance(grace, int) and not isinstance(grace, bool)
    if not whole or not 0 <= grace <= GREATEST_GRACE:
        raise InputError(
            f"{where}: key 'grace' is {shown(grace)}; it is a whole number of steps, "
            f"from 0 to {GREATEST_GRACE}"
        )
    try:
        formula = parse_formula(entry["when"])
    except InputError as error:
        raise InputError(f"{where}: key 'when': {error}") from error
    return {
        "source": entry["from"],
        "target": entry["to"],
        "when": formula,
        "dwell": float(dwell),
        "grace": grace,
    }
