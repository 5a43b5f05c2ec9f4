"""Gaits as data: the YAML files that name a reward machine and the commands it is meant for."""

import hashlib
from collections import deque
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from models.errors import InputError
from models.task.formula import Formula, parse_formula

GAIT_DIRECTORY = Path(__file__).parent / "gaits"

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
_OPTIONAL_KEYS = {"sink": str}
_TRANSITION_KEYS = {"from", "to", "when"}
_OPTIONAL_TRANSITION_KEYS = {"dwell", "grace"}


@dataclass(frozen=True)
class Transition:
    """An edge of a reward machine.

    Attributes:
        source: State it leaves.
        target: State it enters.
        when: Stance in which it fires; feet that the formula keeps in the air must also clear the
            ground by the gait's `clearance`.
        dwell: Fraction of the commanded iterations that the machine must have spent in `source`.
        grace: Control steps since the episode's start before which it cannot fire.
    """

    source: str
    target: str
    when: Formula
    dwell: float = 1.0
    grace: int = 0


@dataclass(frozen=True)
class Gait:
    """A gait: the reward machine's definition and the commands it is trained for.

    Attributes:
        name: Name of the gait and of its file.
        description: One sentence on the footfall.
        states: Names of the machine's states; the one-hot observation follows this order.
        initial: State at the start of an episode.
        sink: Absorbing state that earns nothing, or None.
        transitions: The machine's edges.
        clearance: Height that swing feet must reach before a transition fires (m).
        dwell: Least and greatest commanded number of iterations in a state (control steps).
        max_speed: Greatest commanded forward speed (m/s).
        max_yaw_rate: Greatest commanded yaw rate (rad/s).
    """

    name: str
    description: str
    states: tuple[str, ...]
    initial: str
    sink: str | None
    transitions: tuple[Transition, ...]
    clearance: float
    dwell: tuple[int, int]
    max_speed: float
    max_yaw_rate: float

    @property
    def n_states(self) -> int:
        """Number of the machine's states."""
        return len(self.states)

    def digest(self) -> str:
        """Tells gaits apart that differ in anything, their name included."""
        return hashlib.sha256(repr(self).encode()).hexdigest()[:16]


def gait_names() -> tuple[str, ...]:
    """Lists the gaits that ship with the project."""
    return tuple(sorted(path.stem for path in GAIT_DIRECTORY.glob("*.yaml")))


def load_gait(gait: str | Path) -> Gait:
    """Loads a gait by its name, or from a YAML file of one's own.

    Raises:
        InputError: if there is no such gait, or its file breaks a rule; the message names the
            file, the key and the remedy.
    """
    path = Path(gait)
    if path.suffix not in (".yaml", ".yml"):
        path = GAIT_DIRECTORY / f"{gait}.yaml"
        if not path.exists():
            raise InputError(
                f"unknown gait {str(gait)!r}; the gaits are {', '.join(gait_names())}, "
                "or give the path of a gait file ending in .yaml"
            )
    try:
        text = path.read_text()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    try:
        return parse_gait(text, name=path.stem)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def parse_gait(text: str, *, name: str) -> Gait:
    """Reads a gait from YAML text and checks its reward machine.

    Raises:
        InputError: if a key is missing, unknown or of the wrong kind, a formula or state is
            unknown, a state cannot be reached, or two transitions can fire together.
    """
    try:
        data = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(f"is not valid YAML ({_first_line(error)}); mend that line") from error
    data = _checked_keys(data)
    gait = Gait(
        name=name,
        description=data["description"],
        states=_state_names(data["states"]),
        initial=data["initial"],
        sink=data.get("sink"),
        transitions=tuple(_transition(entry, i) for i, entry in enumerate(data["transitions"])),
        clearance=_positive(data, "clearance"),
        dwell=_dwell_range(data["dwell"]),
        max_speed=_positive(data, "max_speed"),
        max_yaw_rate=_positive(data, "max_yaw_rate"),
    )
    _check_states(gait)
    _check_reachability(gait)
    _check_determinism(gait)
    return gait


def _checked_keys(data: Any) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise InputError("is not a mapping; start from one of the shipped gait files")
    known = _KEYS | _OPTIONAL_KEYS
    for key in data:
        if key not in known:
            raise InputError(f"unknown key {key!r}; the keys are {', '.join(known)}")
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
        wanted = {str: "text", list: "a list"}.get(kind, "a number")
        raise InputError(f"key {key!r} must be {wanted}, not {data[key]!r}")


def _positive(data: dict[str, Any], key: str) -> float:
    value = float(data[key])
    if not 0 < value < float("inf"):
        raise InputError(f"key {key!r} is {value:g}; it must be a number greater than 0")
    return value


def _state_names(states: list[Any]) -> tuple[str, ...]:
    for state in states:
        if not isinstance(state, str):
            raise InputError(f"key 'states' holds {state!r}; states are named by text")
    if len(states) < 2 or len(set(states)) != len(states):
        raise InputError("key 'states' must name at least two different states")
    return tuple(states)


def _dwell_range(dwell: list[Any]) -> tuple[int, int]:
    whole = all(isinstance(value, int) and not isinstance(value, bool) for value in dwell)
    if not (whole and len(dwell) == 2 and 1 <= dwell[0] <= dwell[1]):
        raise InputError(f"key 'dwell' is {dwell}; give the least and greatest, such as [6, 11]")
    return dwell[0], dwell[1]


def _transition(entry: Any, index: int) -> Transition:
    where = f"transitions[{index}]"
    if not isinstance(entry, dict):
        raise InputError(f"{where} is not a mapping; write {{from: q0, to: q1, when: FL & RR}}")
    known = _TRANSITION_KEYS | _OPTIONAL_TRANSITION_KEYS
    for key in entry:
        if key not in known:
            raise InputError(f"{where}: unknown key {key!r}; the keys are {sorted(known)}")
    for key in sorted(_TRANSITION_KEYS):
        if key not in entry:
            raise InputError(f"{where}: missing key {key!r}; add it")
        if not isinstance(entry[key], str):
            raise InputError(f"{where}: key {key!r} must be text, not {entry[key]!r}")
    dwell, grace = entry.get("dwell", 1.0), entry.get("grace", 0)
    if isinstance(dwell, bool) or not isinstance(dwell, (int, float)) or not 0 <= dwell <= 1:
        raise InputError(f"{where}: key 'dwell' is {dwell!r}; it is a fraction from 0 to 1")
    if isinstance(grace, bool) or not isinstance(grace, int) or grace < 0:
        raise InputError(f"{where}: key 'grace' is {grace!r}; it is a whole number of steps")
    try:
        formula = parse_formula(entry["when"])
    except InputError as error:
        raise InputError(f"{where}: key 'when': {error}") from error
    return Transition(entry["from"], entry["to"], formula, float(dwell), grace)


def _check_states(gait: Gait) -> None:
    named = [("initial", gait.initial)]
    if gait.sink is not None:
        named.append(("sink", gait.sink))
    for i, transition in enumerate(gait.transitions):
        named.append((f"transitions[{i}]: key 'from'", transition.source))
        named.append((f"transitions[{i}]: key 'to'", transition.target))
        if transition.source == gait.sink:
            raise InputError(f"transitions[{i}] leaves the sink {gait.sink!r}; remove it")
    for where, state in named:
        if state not in gait.states:
            raise InputError(
                f"{where} names unknown state {state!r}; the states are {', '.join(gait.states)}"
            )


def _check_reachability(gait: Gait) -> None:
    reached, frontier = {gait.initial}, deque([gait.initial])
    while frontier:
        state = frontier.popleft()
        for transition in gait.transitions:
            if transition.source == state and transition.target not in reached:
                reached.add(transition.target)
                frontier.append(transition.target)
    for state in gait.states:
        if state not in reached:
            raise InputError(
                f"state {state!r} cannot be reached from {gait.initial!r}; "
                "add a transition to it or remove it"
            )


def _check_determinism(gait: Gait) -> None:
    for (i, first), (j, second) in combinations(enumerate(gait.transitions), 2):
        both = np.array(first.when.table) & np.array(second.when.table)
        if first.source == second.source and both.any():
            raise InputError(
                f"transitions[{i}] and transitions[{j}] leave {first.source!r} and can fire "
                f"together; make {first.when.text!r} and {second.when.text!r} exclude each other"
            )


def _first_line(error: yaml.YAMLError) -> str:
    return " ".join(str(error).split())
