"""Reads formula files, which `glassgait.models.formulas.file` describes."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from keyword import iskeyword
from typing import Annotated, Any, ClassVar, Literal

import yaml
from annotated_types import Ge, Le, MinLen

from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import DEFINITIONS, EVERY_STATE, FORMAT, FormulaFile
from glassgait.models.formulas.grammar import TextError, parse_formula, refuse_unprintable
from glassgait.models.formulas.mirror import FormulaMirror, Place, completed
from glassgait.models.formulas.quantities import Definition, Range, Readings, Vocabulary
from glassgait.models.plain_yaml import parse_yaml
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import Gains, JointLaw
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.settings import Settings, checked
from glassgait.models.task.gait import MOST_STATES, Gait, gait_names, parse_gait, shipped_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import refuse_other_mirror

MAX_TEXT = 1_000_000
"""Greatest number of characters of a file."""

MAX_DEFINITIONS = 200

_STATE = re.compile(r"state (\d{1,3})")
_STATEMENT = re.compile(r"([A-Za-z_][\w.]*) *=(?!=)(.*)", re.DOTALL)
_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)?")


def read_formulas(text: str) -> FormulaFile:
    """Reads a formula file.

    Raises:
        InputError: if the text is not valid; the message begins with line and column.
    """
    try:
        if len(text) > MAX_TEXT:
            raise TextError(f"holds more than {MAX_TEXT} characters; write less", 1, 1)
        refuse_unprintable(text, "a formula file")
        lines = text.split("\n")
        # The header ends where the first section begins.
        first = next((i for i, line in enumerate(lines) if _is_title(_bare(line))), len(lines))
        header = _read_header("\n".join(lines[:first]))
        return _Formulas(header).read(lines, first)
    except TextError as error:
        raise InputError(f"line {error.line}, column {error.column}: {error}") from error


@checked
class _Keys(Settings):
    """The keys of a header, but for the machine."""

    title: ClassVar[str] = "header"

    format: int
    gait: Annotated[str, MinLen(1)]
    states: Annotated[int, Ge(1), Le(MOST_STATES)]
    robot: Annotated[str, MinLen(1)] = DEFAULT_ROBOT
    senses: Literal["imu"] | None = None
    mirror: tuple[int, ...] | None = None
    gains: Gains | None = None
    limited: bool = False
    limits: TargetLimits | None = None
    odometry: Odometry | None = None
    readings: dict[str, Range] | None = None

    def __post_init__(self) -> None:
        states = range(self.states)
        # The mirror image of the mirror image is the robot.
        if (image := self.mirror) is not None and (
            sorted(image) != [*states] or any(image[image[state]] != state for state in states)
        ):
            raise InputError("mirror must name the image of each state, such as [1, 0]")


@dataclass(frozen=True)
class _Header:
    """A header: its keys, the gait and the ranges that it holds, and its text."""

    keys: _Keys
    machine: Gait | None
    readings: Readings | None
    text: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the observations."""
        return ObservationLayout(self.keys.states, imu=self.keys.senses is not None).names

    def refuse_other_mirror(self, gait: Gait) -> None:
        try:
            refuse_other_mirror(self.keys.mirror, gait)
        except InputError as error:
            raise _in_header(error, self.text) from error


def _read_header(text: str) -> _Header:
    try:
        said = parse_yaml(text)
        if not isinstance(said, dict) or said.get("format") != FORMAT:
            raise InputError(f"a formula file begins with 'format: {FORMAT}'; write such a header")
        machine = said.pop("machine", None)
        keys = _Keys.from_plain(said, "header")
        ranges = keys.readings
        readings = None if ranges is None else Readings(tuple(ranges.items()))
        header = _Header(keys, _machine(machine, keys), readings, text)
        if readings is not None:
            readings.refuse_others(header.names)
    except InputError as error:
        raise _in_header(error, text) from error
    if header.machine is not None:
        header.refuse_other_mirror(header.machine)
    return header


def _machine(said: Any, keys: _Keys) -> Gait | None:
    if said is None:
        return None
    try:
        gait = parse_gait(yaml.safe_dump(said), name=keys.gait)
    except InputError as error:
        raise InputError(f"machine: {error}") from error
    if gait.n_states != keys.states:
        raise InputError(
            f"states is {keys.states}, and the machine has {gait.n_states}; make them the same"
        )
    return gait


def _in_header(error: InputError, text: str) -> TextError:
    """Locates an error at the line of the key that it names, or else at the first line."""
    message = str(error)
    if found := re.search(r"\(line (\d+):", message):
        return TextError(message, int(found[1]), 1)
    lines = [
        (line.partition(":")[0].strip(), i) for i, line in enumerate(text.split("\n"), start=1)
    ]
    of_machine = message.startswith("machine:")
    # A gait has keys of the same names, further down.
    keys = dict(lines if of_machine else reversed(lines))
    for word in re.findall(r"[\w.]+", message)[of_machine:]:
        head, _, rest = word.partition(".")
        for key in (word, rest, head):
            if key and key in keys:
                return TextError(message, keys[key], 1)
    return TextError(message, keys.get("machine", 1) if of_machine else 1, 1)


@dataclass
class _Formulas:
    """Reads the statements below a header."""

    header: _Header
    definitions: list[Definition] = field(default_factory=list)
    formulas: dict[Place, Expression] = field(default_factory=dict)
    section: str = ""

    def __post_init__(self) -> None:
        self.names, self.states = self.header.names, self.header.keys.states
        self.mirror = self.header.keys.mirror
        self.observed = Vocabulary(self.names).symbols

    def read(self, lines: Sequence[str], first: int) -> FormulaFile:
        """Reads the lines from an index on."""
        number = min(first + 1, len(lines))
        for number, statement in _statements(lines, first):
            bare, *more = map(_bare, statement.split("\n"))
            if _is_title(bare):
                if any(more):
                    raise TextError("a title has only one line; do not indent this", number + 1, 1)
                self._begin(bare, number)
            elif assigned := _STATEMENT.fullmatch(statement):
                self._assign(assigned, number)
            else:
                raise TextError(
                    f"{shown(bare)} is no line of a formula file; write 'FL_hip = ...', 'state 0', "
                    "'every state' or 'definitions'",
                    number,
                    1,
                )
        self._end_definitions(number)
        return self._finished(number)

    def _begin(self, title: str, line: int) -> None:
        if title == DEFINITIONS and self.section:
            raise TextError("definitions stand once, before all formulas; move them up", line, 1)
        state = _STATE.fullmatch(title)
        if state and int(state[1]) >= self.states:
            raise TextError(f"there are states 0 to {self.states - 1}; name one", line, 7)
        shared = {len(place) == 1 for place in self.formulas}
        if shared and shared != {title == EVERY_STATE}:
            raise TextError(
                f"formulas serve {EVERY_STATE!r} or one state each, not both; choose", line, 1
            )
        self._end_definitions(line)
        self.section = title

    def _end_definitions(self, line: int) -> None:
        if self.section == DEFINITIONS and self.mirror is not None:
            self.definitions = [*completed(self.names, self.mirror, self.definitions)]
            self._refuse_more(line)

    def _assign(self, assigned: re.Match[str], line: int) -> None:
        name, text = assigned.groups()
        # Definitions do not use other definitions.
        known = [] if self.section == DEFINITIONS else self.definitions
        symbols = (*self.observed, *(definition.symbol for definition in known))
        try:
            formula = parse_formula(text, symbols)
        except TextError as error:
            shift = assigned.start(2) if error.line == 1 else 0
            raise TextError(str(error), error.line + line - 1, error.column + shift) from error
        if self.section == DEFINITIONS:
            self._define(name, formula, text, line)
            return
        place = self._place(name, line)
        if place in self.formulas:
            raise TextError(f"{name} has a formula above; leave one out", line, 1)
        self.formulas[place] = formula

    def _define(self, name: str, formula: Expression, text: str, line: int) -> None:
        defined = (definition.symbol for definition in self.definitions)
        taken = {*self.observed, *defined, *quadruped.JOINTS}
        if name in taken or not _NAME.fullmatch(name) or any(map(iskeyword, name.split("."))):
            raise TextError(f"{shown(name)} cannot be defined; choose another name", line, 1)
        note = text.rstrip().rsplit("\n", maxsplit=1)[-1].partition("#")[2].strip()
        self.definitions.append(Definition(name, formula, note))
        self._refuse_more(line)

    def _refuse_more(self, line: int) -> None:
        if len(self.definitions) > MAX_DEFINITIONS:
            raise TextError(f"there are more than {MAX_DEFINITIONS} definitions", line, 1)

    def _place(self, name: str, line: int) -> Place:
        if name not in quadruped.JOINTS:
            raise TextError(
                f"{shown(name)} is no joint; the joints are {', '.join(quadruped.JOINTS)}", line, 1
            )
        joint = quadruped.JOINTS.index(name)
        state = _STATE.fullmatch(self.section)
        return (int(state[1]), joint) if state else (joint,)

    def _finished(self, last: int) -> FormulaFile:
        """Adds mirror images, and asks that there is a formula of each joint and state."""
        keys, formulas = self.header.keys, self.formulas
        vocabulary = Vocabulary(self.names, tuple(self.definitions))
        if formulas and self.mirror is not None:
            formulas = FormulaMirror.of(vocabulary, self.mirror).complete(formulas)
        joints = range(quadruped.N_JOINTS)
        shared = any(len(place) == 1 for place in formulas)
        wanted = [(j,) for j in joints] if shared else [*_places(self.states)]
        for place in wanted:
            if place not in formulas:
                if self.header.machine is None and keys.gait in gait_names():
                    # With a wrong mirror, images that were left out stand elsewhere.
                    self.header.refuse_other_mirror(shipped_gait(keys.gait))
                where = "" if len(place) == 1 else f" in state {place[0]}"
                joint = quadruped.JOINTS[place[-1]]
                raise TextError(f"the file ends without a formula of {joint}{where}", last, 1)
        return FormulaFile(
            keys.gait,
            vocabulary,
            {place: formulas[place] for place in wanted},
            self.mirror,
            JointLaw(keys.gains, keys.limited, keys.limits),
            keys.robot,
            keys.odometry,
            self.header.readings,
            self.header.machine,
        )


def _places(n_states: int) -> Iterator[Place]:
    return ((state, joint) for state in range(n_states) for joint in range(quadruped.N_JOINTS))


def _bare(line: str) -> str:
    return line.partition("#")[0].rstrip()


def _is_title(line: str) -> bool:
    return line in (DEFINITIONS, EVERY_STATE) or bool(_STATE.fullmatch(line))


def _statements(lines: Sequence[str], first: int) -> Iterator[tuple[int, str]]:
    """Joins lines with the indented ones that follow; yields the number of the first of each."""
    number, statement = 0, ""
    for index, line in enumerate(lines[first:], start=first + 1):
        bare = _bare(line).strip()
        if line.startswith(" ") and bare:
            if not statement:
                raise TextError("nothing stands before this line; do not indent it", index, 1)
            statement += f"\n{line}"
            continue
        if statement and bare:
            yield number, statement
            statement = ""
        if bare:
            number, statement = index, line
        elif statement:
            # Comments and empty lines within a formula keep its lines in step with the file's.
            statement += "\n"
    if statement:
        yield number, statement
