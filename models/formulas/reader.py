"""Reads formula files; `glassgait.models.formulas.file` describes them."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from keyword import iskeyword
from typing import Annotated, Any, ClassVar, Literal

import yaml
from annotated_types import Ge, Le, MinLen

from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import parse_yaml
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import DEFINITIONS, EVERY_STATE, FORMAT, FormulaFile
from glassgait.models.formulas.grammar import TextError, parse_formula, refuse_unprintable
from glassgait.models.formulas.mirror import FormulaMirror, Place, completed
from glassgait.models.formulas.quantities import Definition, Range, Readings, Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_ROBOT, Gains, JointLaw, TargetLimits
from glassgait.models.settings import Settings, checked
from glassgait.models.task import MOST_STATES
from glassgait.models.task.gait import gait_names, parse_gait, shipped_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import refuse_other_mirror

MAX_TEXT = 1_000_000  # greatest number of characters of a file

MAX_DEFINITIONS = 200

_STATE = re.compile(r"state (\d{1,3})")
_STATEMENT = re.compile(r"([A-Za-z_][\w.]*) *=(?!=)(.*)", re.DOTALL)
_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)?")


def read_formulas(text: str) -> FormulaFile:
    """Reads a formula file; the message of an `InputError` begins with line and column."""
    try:
        if len(text) > MAX_TEXT:
            raise TextError(f"holds more than {MAX_TEXT} characters; write less", 1, 1)
        refuse_unprintable(text, "a formula file")
        # The header ends where the first section begins.
        lines = text.split("\n")
        first = next((i for i, line in enumerate(lines) if _is_title(_bare(line))), len(lines))
        header = "\n".join(lines[:first])
        try:
            return _Formulas(_content(header)).read(lines, first)
        except TextError:
            raise
        except InputError as error:
            raise TextError(str(error), _line_of(str(error), header), 1) from error
    except TextError as error:
        raise InputError(f"line {error.line}, column {error.column}: {error}") from error


@checked
class _Header(Settings):
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
    machine: dict[str, Any] | None = None
    readings: dict[str, Range] | None = None

    def __post_init__(self) -> None:
        states = range(self.states)
        # Each state must be the image of its image.
        if (image := self.mirror) is not None and (
            sorted(image) != [*states] or any(image[image[state]] != state for state in states)
        ):
            raise InputError("mirror must name the image of each state, such as [1, 0]")


def _content(text: str) -> FormulaFile:
    """Reads the header of a file, as a file without formulas."""
    plain = parse_yaml(text)
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise InputError(f"a formula file begins with 'format: {FORMAT}'; write such a header")
    header = _Header.from_plain(plain, "header")
    names = ObservationLayout(header.states, imu=header.senses is not None).names
    # Build the ranges and the gait, and compare them with the other keys.
    readings = machine = None
    if header.readings is not None:
        readings = Readings(tuple(header.readings.items()))
        readings.refuse_others(names)
    if header.machine is not None:
        try:
            machine = parse_gait(yaml.safe_dump(header.machine), name=header.gait)
        except InputError as error:
            raise InputError(f"machine: {error}") from error
        if machine.n_states != header.states:
            raise InputError(
                f"states is {header.states}, but the machine has {machine.n_states}; correct one"
            )
        refuse_other_mirror(header.mirror, machine)
    return FormulaFile(
        header.gait,
        Vocabulary(names),
        {},
        header.mirror,
        JointLaw(header.gains, header.limited, header.limits),
        header.robot,
        header.odometry,
        readings,
        machine,
    )


def _line_of(message: str, header: str) -> int:
    """Returns the line of the first key that a message names, or else the first line."""
    if line := re.search(r"\(line (\d+):", message):
        return int(line[1])
    numbered = enumerate(header.split("\n"), start=1)
    lines = [(line.partition(":")[0].strip(), number) for number, line in numbered]
    # The gait, further down, has keys with the same names as keys of the header.
    of_machine = message.startswith("machine:")
    keys = dict(lines if of_machine else reversed(lines))
    # Look for a nested key, such as limits.lean, by its last and then by its first part.
    for word in re.findall(r"[\w.]+", message)[of_machine:]:
        head, _, rest = word.partition(".")
        for key in (word, rest, head):
            if key and key in keys:
                return keys[key]
    return keys.get("machine", 1) if of_machine else 1


class _Formulas:
    """Reads the statements below a header."""

    def __init__(self, content: FormulaFile) -> None:
        self.content, self.mirror = content, content.mirror
        self.names, self.observed = content.vocabulary.names, content.vocabulary.symbols
        self.states = range(ObservationLayout.of(self.names).n_machine_states)
        self.definitions: list[Definition] = []
        self.formulas: dict[Place, Expression] = {}
        self.sections, self.section = list[str](), ""

    def read(self, lines: Sequence[str], first: int) -> FormulaFile:
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
                problem = "is no line of a formula file; write 'FL_hip = ...' or a title"
                raise TextError(f"{shown(bare)} {problem}", number, 1)
        self._end_definitions()
        return self._finished(number)

    def _begin(self, title: str, line: int) -> None:
        if title in self.sections:
            raise TextError(f"{title!r} occurs twice; join the two sections", line, 1)
        if title == DEFINITIONS and self.sections:
            raise TextError("definitions must be before all formulas; move them up", line, 1)
        # Formulas are either all for single states, or all for every state.
        state = _STATE.fullmatch(title)
        if state and int(state[1]) not in self.states:
            raise TextError(f"there are states 0 to {len(self.states) - 1}; name one", line, 7)
        shared = {len(place) == 1 for place in self.formulas}
        if shared and shared != {title == EVERY_STATE}:
            raise TextError(
                f"formulas are for {EVERY_STATE!r} or for one state each, not both", line, 1
            )
        self._end_definitions()
        self.sections.append(title)
        self.section = title

    def _end_definitions(self) -> None:
        if self.section == DEFINITIONS and self.mirror is not None:
            self.definitions = [*completed(self.names, self.mirror, self.definitions)]

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
        # All other sections contain formulas of joints.
        if name not in quadruped.JOINTS:
            raise TextError(
                f"{shown(name)} is no joint; the joints are {', '.join(quadruped.JOINTS)}", line, 1
            )
        joint, state = quadruped.JOINTS.index(name), _STATE.fullmatch(self.section)
        place = (int(state[1]), joint) if state else (joint,)
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
        if len(self.definitions) > MAX_DEFINITIONS:
            raise TextError(f"there are more than {MAX_DEFINITIONS} definitions", line, 1)

    def _finished(self, last: int) -> FormulaFile:
        """Adds mirror images, and checks that each joint and state has a formula."""
        vocabulary, formulas = Vocabulary(self.names, tuple(self.definitions)), self.formulas
        if formulas and self.mirror is not None:
            formulas = FormulaMirror.of(vocabulary, self.mirror).complete(formulas)
        # Raise an error for the first formula that is missing.
        joints = range(quadruped.N_JOINTS)
        shared = any(len(place) == 1 for place in formulas)
        places = [(j,) for j in joints] if shared else [(s, j) for s in self.states for j in joints]
        if missing := next((place for place in places if place not in formulas), None):
            if self.content.gait in gait_names():
                # A wrong mirror would put the images in other places.
                refuse_other_mirror(self.mirror, shipped_gait(self.content.gait))
            in_state = f" in state {missing[0]}" if len(missing) > 1 else ""
            joint = quadruped.JOINTS[missing[-1]]
            raise TextError(f"the file ends without a formula of {joint}{in_state}", last, 1)
        formulas = {place: formulas[place] for place in places}
        return replace(self.content, vocabulary=vocabulary, formulas=formulas)


def _bare(line: str) -> str:
    return line.partition("#")[0].rstrip()


def _is_title(line: str) -> bool:
    return line in (DEFINITIONS, EVERY_STATE) or bool(_STATE.fullmatch(line))


def _statements(lines: Sequence[str], first: int) -> Iterator[tuple[int, str]]:
    """Joins lines with the indented ones below; yields statements and their first line numbers."""
    number, statement = 0, ""
    for index, line in enumerate(lines[first:], start=first + 1):
        bare = _bare(line).strip()
        if line.startswith(" ") and bare:
            if not statement:
                raise TextError("there is no line to continue; do not indent this one", index, 1)
            statement += f"\n{line}"
        elif bare:
            if statement:
                yield number, statement
            number, statement = index, line
        elif statement:
            # Keep comments and empty lines within a formula, for the line numbers of errors.
            statement += "\n"
    if statement:
        yield number, statement
