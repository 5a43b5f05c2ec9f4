"""Gaits as data: the YAML files that name a reward machine and the commands it is meant for."""

import hashlib
import os
from collections import deque
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from glassgait.models.errors import InputError, brief, shown
from glassgait.models.files import YAML_BYTES, parse_yaml, read_text
from glassgait.models.task.formula import N_STANCES, Formula, parse_formula

GAIT_DIRECTORY = Path(__file__).resolve().parent / "gaits"

LONGEST_STATE = 40
"""Greatest number of characters of a state's name."""

LONGEST_NAME = 80
TAKEN_NAMES = ("checkpoint", "config")
"""Names that the files of a training run have, beside those of the gait's expert."""

"""Greatest number of characters of a gait's name, which stands in the names of its files."""

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


def gait_path(gait: str | Path) -> Path:
    """Returns the file of a gait that ships with the project, or of one of one's own.

    Args:
        gait: Name of a gait that ships, or path of a gait file.

    Raises:
        InputError: if there is no such gait, or the file's name can name no gait.
    """
    path = Path(gait)
    if path.suffix in (".yaml", ".yml"):
        _check_name(path)
        return path
    if str(gait) not in gait_names():
        raise InputError(
            f"unknown gait {shown(str(gait))}; the gaits are {', '.join(gait_names())}, "
            "or give the path of a gait file ending in .yaml"
        )
    return GAIT_DIRECTORY / f"{gait}.yaml"


def load_gait(gait: str | Path) -> Gait:
    """Loads a gait by its name, or from a YAML file of one's own.

    Raises:
        InputError: if there is no such gait, or its file breaks a rule; the message names the
            file, the key and the remedy.
    """
    path = gait_path(gait)
    text = read_text(path, YAML_BYTES)
    try:
        loaded = parse_gait(text, name=path.stem)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    shipped = GAIT_DIRECTORY / f"{path.stem}.yaml"
    if shipped.exists() and path.resolve() != shipped and loaded != load_gait(path.stem):
        # Policies know their gait by its name.
        raise InputError(
            f"{path}: is called like the gait {path.stem!r} that ships, and differs from it; give "
            "the file another name"
        )
    return loaded


def parse_gait(text: str, *, name: str) -> Gait:
    """Reads a gait from YAML text and checks its reward machine.

    Raises:
        InputError: if a key is missing, unknown, of the wrong kind or out of range, a formula or
            state is unknown, a state cannot be reached, or two transitions can fire together.
    """
    data = _checked_keys(parse_yaml(text))
    gait = Gait(
        name=name,
        description=_description(data["description"]),
        states=_state_names(data["states"]),
        initial=data["initial"],
        sink=data.get("sink"),
        transitions=_transitions(data["transitions"]),
        clearance=_positive(data, "clearance"),
        dwell=_dwell_range(data["dwell"]),
        max_speed=_positive(data, "max_speed"),
        max_yaw_rate=_positive(data, "max_yaw_rate"),
    )
    _check_states(gait)
    _check_reachability(gait)
    _check_determinism(gait)
    return gait


def _check_name(path: Path) -> None:
    """Refuses names of files that cannot name a gait and, after it, the files of its runs."""
    name = path.stem
    # The file system counts bytes.
    short = len(os.fsencode(name)) <= LONGEST_NAME
    if not short or not _is_plain(name, LONGEST_NAME) or name.startswith("."):
        raise InputError(
            f"gait file {shown(str(path))}: the gait takes its name from the file; rename it to "
            f"printable characters, {LONGEST_NAME} bytes at most, that start with no dot"
        )
    if name in TAKEN_NAMES:
        raise InputError(
            f"gait file {shown(str(path))}: a run keeps a file of its own under the name {name!r}; "
            "give the gait another one"
        )


def _is_plain(name: str, longest: int) -> bool:
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
        wanted = {str: "text", list: "a list"}.get(kind, "a number")
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
        if not _is_plain(state, LONGEST_STATE):
            raise InputError(
                f"key 'states' holds {shown(state)}; name states by printable characters, "
                f"{LONGEST_STATE} at most, with no space at the ends"
            )
    if not 2 <= len(states) <= MOST_STATES or len(set(states)) != len(states):
        raise InputError(
            f"key 'states' must name at least two different states, and {MOST_STATES} at most"
        )
    return tuple(states)


def _dwell_range(dwell: list[Any]) -> tuple[int, int]:
    whole = all(isinstance(value, int) and not isinstance(value, bool) for value in dwell)
    if not (whole and len(dwell) == 2 and 1 <= dwell[0] <= dwell[1] <= GREATEST_DWELL):
        raise InputError(
            f"key 'dwell' is {shown(dwell)}; give the least and greatest, such as [6, 11], "
            f"{GREATEST_DWELL} at most"
        )
    return dwell[0], dwell[1]


def _transitions(entries: list[Any]) -> tuple[Transition, ...]:
    most = MOST_STATES * N_STANCES
    if len(entries) > most:
        raise InputError(f"key 'transitions' holds {len(entries)}; {most} are the most")
    return tuple(_transition(entry, i) for i, entry in enumerate(entries))


def _transition(entry: Any, index: int) -> Transition:
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
    return Transition(entry["from"], entry["to"], formula, float(dwell), grace)


def _check_states(gait: Gait) -> None:
    named = [("initial", gait.initial)]
    if gait.sink is not None:
        named.append(("sink", gait.sink))
    for i, transition in enumerate(gait.transitions):
        named.append((f"transitions[{i}]: key 'from'", transition.source))
        named.append((f"transitions[{i}]: key 'to'", transition.target))
        if transition.source == gait.sink:
            raise InputError(f"transitions[{i}] leaves the sink {shown(gait.sink)}; remove it")
    for where, state in named:
        if state not in gait.states:
            raise InputError(
                f"{where} names unknown state {shown(state)}; the states are "
                f"{brief(', '.join(gait.states))}"
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
                f"state {shown(state)} cannot be reached from {shown(gait.initial)}; "
                "add a transition to it or remove it"
            )


def _check_determinism(gait: Gait) -> None:
    for (i, first), (j, second) in combinations(enumerate(gait.transitions), 2):
        if first.source != second.source:
            continue
        if (np.array(first.when.table) & np.array(second.when.table)).any():
            raise InputError(
                f"transitions[{i}] and transitions[{j}] leave {shown(first.source)} and can fire "
                f"together; make {shown(first.when.text)} and {shown(second.when.text)} exclude "
                "each other"
            )
