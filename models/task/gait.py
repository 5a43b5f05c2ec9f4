"""Gaits as data: a reward machine and the ranges of its commands, read from a YAML file.

A transition fires in the stances of a boolean formula over the feet's contacts, such as
`FL & RR & ~FR & ~RL`. Python's parser reads these formulas, restricted to the names of the feet,
`&`, `|`, `~` and parentheses. They become truth tables over the 16 stances; nothing is executed.

The header of a formula file may hold the same YAML: `policies.library.find_gait` reads both.
"""

import ast
import hashlib
import os
import re
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import combinations
from math import inf
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final

import numpy as np
import yaml
from annotated_types import Ge, Le, MaxLen, MinLen
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field

from glassgait.models.errors import InputError, brief, shown, unknown_name
from glassgait.models.files import YAML_BYTES, parse_yaml, read_text
from glassgait.models.robots.quadruped import LEGS, N_LEGS
from glassgait.models.settings import DISTINCT, IN_ORDER, Settings, checked
from glassgait.models.task import MOST_STATES

GAIT_DIRECTORY = Path(__file__).resolve().parent / "gaits"
FREE = "free"  # name of the gait without transitions, in which policies of any rhythm act

# Greatest lengths, of the name in bytes, of the others in characters. Every formula over four feet
# can be written shorter.
LONGEST_NAME, LONGEST_STATE, LONGEST_DESCRIPTION, LONGEST_FORMULA = 80, 40, 500, 1000

N_STANCES: Final = 2**N_LEGS

STANCES: Final[NDArray[np.bool_]] = (np.arange(N_STANCES)[:, None] >> np.arange(N_LEGS) & 1).astype(
    bool
)
"""The feet that touch (16, 4), by stance code; foot i contributes 2**i to the code."""

_FOREIGN = re.compile(r"[^A-Za-z_&|~()\s]")


@dataclass(frozen=True)
class Formula:
    """A boolean formula over the feet's contacts, as text and as a table by stance code (16)."""

    text: str
    table: tuple[bool, ...]

    @property
    def swing_feet(self) -> tuple[bool, ...]:
        """The feet (4) that are in the air in every stance where the formula holds."""
        return tuple(map(bool, ~np.any(STANCES[np.array(self.table)], axis=0)))


def stance_code(contact: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Encodes contacts (..., 4) as stance codes (...) in 0..15."""
    return contact.astype(np.intp) @ (1 << np.arange(contact.shape[-1]))


def parse_formula(text: str) -> Formula:
    """Reads a formula over FL, FR, RL and RR, and refuses one that can never hold."""
    # Line breaks would end the formula early, and break drawings.
    text = " ".join(text.split())
    if len(text) > LONGEST_FORMULA:
        raise InputError(
            f"formula {shown(text)} is longer than {LONGEST_FORMULA} characters; simplify it"
        )
    # Python's parser accepts whole programs, so refuse all other characters first.
    if foreign := _FOREIGN.search(text):
        raise InputError(
            f"{shown(foreign[0])} does not belong in a formula; "
            "use foot names with & (and), | (or), ~ (not) and parentheses"
        )
    try:
        table = _evaluate(ast.parse(text, mode="eval").body)
    except (SyntaxError, RecursionError, MemoryError, ValueError) as error:
        raise InputError(
            f"formula {shown(text)} cannot be read; write it like 'FL & RR & ~FR & ~RL'"
        ) from error
    if not table.any():
        raise InputError(f"formula {shown(text)} can never hold; remove a contradiction from it")
    return Formula(text, tuple(table.tolist()))


def _evaluate(node: ast.expr) -> NDArray[np.bool_]:
    match node:
        case ast.Name(id=name) if name in LEGS:
            return STANCES[:, LEGS.index(name)]
        case ast.Name(id=name):
            raise InputError(f"unknown foot {shown(name)}; the feet are {', '.join(LEGS)}")
        case ast.UnaryOp(op=ast.Invert(), operand=operand):
            return ~_evaluate(operand)
        case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
            return _evaluate(left) & _evaluate(right)
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            return _evaluate(left) | _evaluate(right)
        case _:
            raise InputError(f"{shown(ast.unparse(node))} does not belong in a formula; remove it")


def _name(name: str) -> str:
    plain = name.isprintable() and name == name.strip() and not {*name} & {"/", "\\"}
    # The file system counts bytes.
    if not plain or name.startswith(".") or not 0 < len(os.fsencode(name)) <= LONGEST_NAME:
        raise ValueError(f"printable, at most {LONGEST_NAME} bytes, and without a leading dot")
    if name in ("checkpoint", "config"):
        raise ValueError("another name, since runs have a file of this name")
    return name


def _plain(text: str, longest: int) -> str:
    # In a formula file, # always begins a comment.
    plain = text.isprintable() and text == text.strip() and "#" not in text
    if not plain or not 0 < len(text) <= longest:
        raise ValueError(
            f"1 to {longest} printable characters without # and without spaces at the ends"
        )
    return text


StateName = Annotated[str, AfterValidator(lambda name: _plain(name, LONGEST_STATE))]
Description = Annotated[
    str, AfterValidator(lambda text: _plain(" ".join(text.split()), LONGEST_DESCRIPTION))
]


def _formula(text: Any) -> Any:
    return parse_formula(text) if isinstance(text, str) else text


Dwell = Annotated[int, Ge(1), Le(1000)]


@checked
class Transition(Settings):
    """An edge of a reward machine. Files call its states "from" and "to"."""

    title: ClassVar[str] = "transition"

    source: Annotated[str, Field(validation_alias="from")]  # State it leaves.
    target: Annotated[str, Field(validation_alias="to")]  # State it enters.
    # Stance in which it fires; feet that the formula keeps in the air must also clear the ground by
    # the gait's `clearance`.
    when: Annotated[Formula, BeforeValidator(_formula)]
    # Fraction of the commanded iterations that the machine must have spent in `source`.
    dwell: Annotated[float, Ge(0.0), Le(1.0)] = 1.0
    # Control steps since the episode's start before which it cannot fire.
    grace: Annotated[int, Ge(0), Le(100_000)] = 0


@checked
class Gait(Settings):
    """A gait: the reward machine's definition and the commands it is trained for."""

    title: ClassVar[str] = "gait"

    name: Annotated[str, AfterValidator(_name)]
    description: Description  # One sentence on the footfall.
    # Names of the machine's states; the one-hot observation follows this order.
    states: Annotated[tuple[StateName, ...], MinLen(1), MaxLen(MOST_STATES), DISTINCT]
    initial: str
    # States without reward; entering or leaving one earns nothing either.
    faults: Annotated[tuple[str, ...], MaxLen(MOST_STATES), DISTINCT]
    transitions: Annotated[tuple[Transition, ...], MaxLen(MOST_STATES * N_STANCES)]
    # Height that swing feet must reach before a transition fires (m).
    clearance: Annotated[float, Ge(0.001), Le(1.0)]
    # Least and greatest commanded number of iterations in a state (control steps).
    dwell: Annotated[tuple[Dwell, Dwell], IN_ORDER]
    max_speed: Annotated[float, Ge(0.01), Le(10.0)]  # Greatest commanded forward speed (m/s).
    max_yaw_rate: Annotated[float, Ge(0.01), Le(10.0)]  # Greatest commanded yaw rate (rad/s).

    def __post_init__(self) -> None:
        # All named states must exist.
        named = [("initial", self.initial), *(("faults", state) for state in self.faults)]
        for i, edge in enumerate(self.transitions):
            named += [(f"transitions[{i}].from", edge.source)]
            named += [(f"transitions[{i}].to", edge.target)]
        for where, state in named:
            if state not in self.states:
                raise InputError(
                    f"{where} names unknown state {shown(state)}; the states are "
                    f"{brief(', '.join(self.states))}"
                )
        # All states must be reachable; no path needs more transitions than there are states.
        reached = {self.initial}
        for _ in self.states:
            reached |= {edge.target for edge in self.transitions if edge.source in reached}
        for state in self.states:
            if state not in reached:
                raise InputError(
                    f"state {shown(state)} cannot be reached from {shown(self.initial)}; remove it"
                )
        # In each stance, at most one transition may leave a state.
        for (i, first), (j, second) in combinations(enumerate(self.transitions), 2):
            together = np.array(first.when.table) & np.array(second.when.table)
            if first.source == second.source and together.any():
                raise InputError(
                    f"transitions[{i}] and transitions[{j}] leave {shown(first.source)} and can "
                    "fire together; make their formulas exclude each other"
                )

    @property
    def n_states(self) -> int:
        """Number of the machine's states."""
        return len(self.states)

    def digest(self) -> str:
        """Returns a digest of the whole gait, its name included."""
        return hashlib.sha256(repr(self).encode()).hexdigest()[:16]

    def first_difference(self, other: "Gait") -> str | None:
        """Returns the first key in which two gaits behave differently, or None.

        Names, descriptions and the texts of formulas may differ.
        """
        keys = [key.name for key in fields(self) if key.name not in ("name", "description")]
        return next((key for key in keys if self._behaviour(key) != other._behaviour(key)), None)

    def _behaviour(self, key: str) -> object:
        if key == "transitions":
            return [replace(edge, when=replace(edge.when, text="")) for edge in self.transitions]
        return getattr(self, key)


def gait_names() -> tuple[str, ...]:
    """Lists the gaits that ship with the project, except `FREE`."""
    return tuple(sorted({path.stem for path in GAIT_DIRECTORY.glob("*.yaml")} - {FREE}))


def gait_option(name: str) -> str:
    """Returns the command-line option for a gait; one that does not ship is a file."""
    return f"--gait {name}" if name in (*gait_names(), FREE) else f"--gait {name}.yaml"


def load_gait(gait: str | Path) -> Gait:
    """Loads a shipped gait by name, or a gait from the path of a YAML file."""
    path = Path(gait)
    if path.suffix not in (".yaml", ".yml"):
        if str(gait) not in (*gait_names(), FREE):
            remedy = ", or give the path of a gait file ending in .yaml"
            raise unknown_name("gait", gait, gait_names(), remedy)
        path = GAIT_DIRECTORY / f"{gait}.yaml"
    # Refuse another gait with the name of a shipped one: policies store only the name.
    text = read_text(path, YAML_BYTES)
    try:
        loaded = parse_gait(text, name=path.stem)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    shipped = GAIT_DIRECTORY / f"{path.stem}.yaml"
    if shipped.exists() and path.resolve() != shipped and loaded != shipped_gait(path.stem):
        raise InputError(f"{path}: has the name of a gait that ships; give the file another name")
    return loaded


@cache
def shipped_gait(name: str) -> Gait:
    """Returns a gait that ships, read once."""
    return load_gait(name)


def parse_gait(text: str, *, name: str) -> Gait:
    """Reads a gait from YAML text and checks its reward machine."""
    data = parse_yaml(text)
    if not isinstance(data, dict):
        raise InputError("is not a mapping; start from one of the shipped gait files")
    if "name" in data:
        raise InputError("unknown key 'name'; remove it, the file has the name of its gait")
    return Gait.from_plain({"faults": [], **data, "name": name})


def gait_lines(gait: Gait) -> list[str]:
    """Writes a gait as lines of ASCII YAML, from which `parse_gait` reads the same gait."""
    return [
        f"description: {_yaml(gait.description)}",
        f"max_speed: {_yaml(gait.max_speed)}    # m/s",
        f"max_yaw_rate: {_yaml(gait.max_yaw_rate)}    # rad/s",
        f"dwell: {_yaml([*gait.dwell])}    # control steps to stay in a state",
        f"clearance: {_yaml(gait.clearance)}    # m, how high a foot in the air must be",
        f"states: {_yaml([*gait.states])}",
        f"initial: {_yaml(gait.initial)}",
        *([f"faults: {_yaml([*gait.faults])}"] if gait.faults else []),
        "transitions:" if gait.transitions else "transitions: []",
        *(f"  - {_edge(transition)}" for transition in gait.transitions),
    ]


def _edge(edge: Transition) -> str:
    plain: dict[str, Any] = {"from": edge.source, "to": edge.target, "when": edge.when.text}
    plain |= {"dwell": edge.dwell} if edge.dwell != 1.0 else {}
    plain |= {"grace": edge.grace} if edge.grace else {}
    return _yaml(plain)


def _yaml(value: Any) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=inf)
    return text.removesuffix("\n").removesuffix("\n...")
