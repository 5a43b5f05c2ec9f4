"""Reads formula files, whose grammar `glassgait.models.formulas.file` gives."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from keyword import iskeyword

from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.contacts import CONTACTS
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import (
    DEFINITIONS,
    EVERY_STATE,
    FORMAT,
    IMU,
    LIMITED,
    READINGS,
    FormulaFile,
)
from glassgait.models.formulas.limits import LIMITS, limits_of
from glassgait.models.formulas.mirror import FormulaMirror, Place, completed
from glassgait.models.formulas.odometry import ODOMETRY
from glassgait.models.formulas.program import Program
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.formulas.readings import Range, Readings, read_line
from glassgait.models.formulas.text import TextError, parse_formula, refuse_unprintable
from glassgait.models.plain_yaml import key_lines
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.gait import (
    MACHINE,
    MOST_STATES,
    Gait,
    gait_names,
    parse_gait,
    shipped_gait,
)
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.symmetry import refuse_other_mirror

MAX_TEXT = 1_000_000
"""Greatest number of characters of a file."""

MAX_DEFINITIONS = 200

HEADER = ("format", "gait", "robot", "states", "senses", "mirror", "targets", "gains")
"""Keys of a file's header."""

_PROGRAMS: dict[str, Program] = {own.title: own for own in (CONTACTS, ODOMETRY, LIMITS)}
"""The programs that a file may hold, by the titles of their sections."""

_FORMULAS = "formulas"
"""Stands for `every state` and the states in the order of sections."""

_ORDER = (CONTACTS.title, ODOMETRY.title, MACHINE, READINGS, DEFINITIONS, _FORMULAS, LIMITS.title)
"""The order of sections, of which those of states alone may stand more than once."""

_SECTION = re.compile(r"state (\d{1,3})")
_STATEMENT = re.compile(r"([A-Za-z_][\w.]*) *=(?!=)(.*)", re.DOTALL)
_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)?")
_AMOUNT = re.compile(r"[0-9.]+(?:[eE][+-]?[0-9]+)?")
"""Of what `float` reads, the numbers without a sign, as ranges and programs have them."""


_SAID = {"format": f"'format: {FORMAT}'", "gait": "'gait: trot'", "states": "'states: 2'"}


def read_formulas(text: str) -> FormulaFile:
    """Reads a formula file.

    Raises:
        InputError: if the text is none; the message begins with line and column.
    """
    try:
        return _Reader(text).read()
    except TextError as error:
        raise InputError(f"line {error.line}, column {error.column}: {error}") from error


@dataclass
class _Reader:
    """Takes a text line by line."""

    text: str
    header: dict[str, str] = field(default_factory=dict)
    lines: dict[str, int] = field(default_factory=dict)
    definitions: list[Definition] = field(default_factory=list)
    formulas: dict[Place, Expression] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    observed: tuple[str, ...] = ()
    mirror: tuple[int, ...] | None = None
    law: JointLaw = OWN_LAW
    program: dict[str, float] = field(default_factory=dict)
    n_statements: int = 0
    believes: bool = False
    odometry: Odometry | None = None
    ranges: dict[str, Range] = field(default_factory=dict)
    readings: Readings | None = None
    machine: Gait | None = None
    section: str = ""

    def read(self) -> FormulaFile:
        text = self.text
        if len(text) > MAX_TEXT:
            raise TextError(f"holds more than {MAX_TEXT} characters; write less", 1, 1)
        refuse_unprintable(text, "a formula file")
        number = 1
        for number, statement in _statements(text):
            self._take(statement, number)
        return self._finished(number)

    def _take(self, statement: str, line: int) -> None:
        bare, *more = (part.partition("#")[0].rstrip() for part in statement.split("\n"))
        key, colon, value = bare.partition(":")
        is_header = colon and key in HEADER and not self.section
        if (is_header or _is_title(bare)) and any(more):
            raise TextError("nothing goes on from the line above; do not indent this", line + 1, 1)
        if is_header:
            if key in self.header:
                raise TextError(f"{key!r} is said twice; leave one out", line, 1)
            self.header[key] = value.strip()
            self.lines[key] = line
        elif _is_title(bare):
            self._begin(bare, line)
        elif self.section == MACHINE:
            return
        elif program := _PROGRAMS.get(self.section):
            self.program |= program.read(self.n_statements, " ".join([bare, *more]), line)
            self.n_statements += 1
        elif self.section == READINGS:
            self._take_ranges(" ".join([bare, *more]), line)
        elif assigned := _STATEMENT.fullmatch(statement):
            self._assign(assigned, line)
        else:
            raise TextError(
                f"{shown(bare)} is no line of a formula file; write 'FL_hip = …', 'state 0', "
                "'every state', the title of another section (contacts, odometry, machine, "
                "readings, definitions or limits), or a header such as 'gait: trot'",
                line,
                1,
            )

    def _begin(self, title: str, line: int) -> None:
        if not self.section:
            self._take_header(line)
        place = _place_of(title)
        if self.section and place <= _place_of(self.section) and _ORDER[place] != _FORMULAS:
            again = place == _place_of(self.section)
            remedy = "leave one out" if again else f"move it up, before {shown(self.section)}"
            raise TextError(f"{title!r} stands too late, or twice; {remedy}", line, 1)
        if self.section == LIMITS.title:
            raise TextError("limits come last; move them down", line, 1)
        self._end_section(line)
        if _ORDER[place] == _FORMULAS:
            self._refuse_other_state(title, line)
        self.section = title

    def _refuse_other_state(self, title: str, line: int) -> None:
        state = _SECTION.fullmatch(title)
        if state and int(state[1]) >= self._n_states:
            raise TextError(f"there are states 0 to {self._n_states - 1}; name one", line, 7)
        shared = {len(place) == 1 for place in self.formulas}
        if shared and shared != {title == EVERY_STATE}:
            raise TextError(
                f"formulas serve {EVERY_STATE!r} or one state each, not both; choose", line, 1
            )

    def _take_ranges(self, text: str, line: int) -> None:
        for kind, ends in read_line(text, line, self.names).items():
            if kind in self.ranges:
                raise TextError(f"{kind} has a range above; leave one out", line, 1)
            self.ranges[kind] = ends

    def _end_section(self, line: int) -> None:
        if self.section == READINGS:
            self.readings = Readings(tuple(self.ranges.items()))
        if self.section == MACHINE:
            self.machine = self._machine(line)
        if self.section == DEFINITIONS and self.mirror is not None:
            self.definitions = [*completed(self.names, self.mirror, self.definitions)]
            self._refuse_more(line)
        program = _PROGRAMS.get(self.section)
        if program is None:
            return
        program.refuse_end(self.n_statements, line)
        if program is CONTACTS:
            self.believes = True
        elif program is ODOMETRY:
            self.odometry = Odometry(gain=self.program["GAIN"])
        elif program is LIMITS:
            self.law = replace(self.law, limits=limits_of(self.program))
        self.program, self.n_statements = {}, 0

    def _machine(self, end: int) -> Gait:
        """Reads the gait, whose lines keep their numbers."""
        lines = [line.partition("#")[0].rstrip() for line in self.text.split("\n")]
        begin = lines.index(MACHINE) + 1
        titles = (i for i in range(begin, len(lines)) if _is_title(lines[i]))
        text = "\n".join([""] * begin + lines[begin : next(titles, None)])
        numbered = enumerate(text.split("\n"), start=1)
        first = next((number for number, line in numbered if line), end)
        try:
            gait = parse_gait(text, name=self.header["gait"])
        except InputError as error:
            raise TextError(f"machine: {error}", _line_of(error, text) or first, 1) from error
        if gait.n_states != self._n_states:
            raise TextError(
                f"the machine has {gait.n_states} states, and 'states' says {self._n_states}; "
                "make them the same",
                key_lines(text)["states"],
                1,
            )
        self._refuse_other_mirror(gait)
        return gait

    def _refuse_other_mirror(self, gait: Gait) -> None:
        try:
            refuse_other_mirror(self.mirror, gait)
        except InputError as error:
            raise TextError(str(error), self.lines["mirror"], 1) from error

    @property
    def _n_states(self) -> int:
        return int(self.header["states"])

    def _take_header(self, line: int) -> None:
        for key in ("format", "gait", "states"):
            if not self.header.get(key):
                raise TextError(
                    f"the header lacks {key!r}; add a line such as {_SAID[key]}", line, 1
                )
        if self.header["format"] != str(FORMAT):
            raise TextError(
                f"is of format {shown(self.header['format'])}, not {FORMAT}",
                self.lines["format"],
                1,
            )
        if not self.header.get("robot", DEFAULT_ROBOT):
            raise TextError(
                f"robot: must name a robot, such as {DEFAULT_ROBOT}, or be left out",
                self.lines["robot"],
                1,
            )
        if not re.fullmatch(r"\d{1,3}", self.header["states"]) or not (
            1 <= self._n_states <= MOST_STATES
        ):
            raise TextError(
                f"states: must be a number from 1 to {MOST_STATES}", self.lines["states"], 1
            )
        if self.header.get("senses", IMU) != IMU:
            raise TextError(f"senses: must be {IMU!r}, or be left out", self.lines["senses"], 1)
        self.names = ObservationLayout(self._n_states, imu="senses" in self.header).names
        self.observed = Vocabulary(self.names).symbols
        if "mirror" in self.header:
            self.mirror = self._mirror(self.header["mirror"], self.lines["mirror"])
        if self.header.get("targets", LIMITED) != LIMITED:
            raise TextError(
                f"targets: must be {LIMITED!r}, or be left out", self.lines["targets"], 1
            )
        self.law = self._law()

    def _law(self) -> JointLaw:
        limited = "targets" in self.header
        if "gains" not in self.header:
            return JointLaw(limited=limited)
        said = self.header["gains"].split()
        try:
            stiffness, damping = map(float, said if all(map(_AMOUNT.fullmatch, said)) else ())
            return JointLaw((stiffness, damping), limited)
        except (ValueError, InputError) as error:
            raise TextError(
                "gains: must be a stiffness (N·m/rad), above 0 and up to 1000, and a damping "
                "(N·m·s/rad), 0 to 100, such as 40 1",
                self.lines["gains"],
                1,
            ) from error

    def _mirror(self, text: str, line: int) -> tuple[int, ...]:
        images = text.split()
        if all(re.fullmatch(r"\d{1,3}", image) for image in images):
            states = tuple(int(image) for image in images)
            # Whose image is the state itself: the mirror of the mirror is the robot.
            if len(states) == self._n_states and all(
                image < len(states) and states[image] == state for state, image in enumerate(states)
            ):
                return states
        raise TextError(
            "mirror: must name for each state the one that it is in the mirror, such as 1 0",
            line,
            1,
        )

    def _assign(self, assigned: re.Match[str], line: int) -> None:
        name = assigned[1]
        if not self.section:
            raise TextError("a formula stands under 'state 0' or 'every state'", line, 1)
        # What is defined is defined by what the robot senses, not by other definitions.
        known = [] if self.section == DEFINITIONS else self.definitions
        symbols = (*self.observed, *(definition.symbol for definition in known))
        formula = _located(assigned, line, symbols)
        if self.section == DEFINITIONS:
            self._define(name, formula, assigned[2], line)
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
        state = _SECTION.fullmatch(self.section)
        return (int(state[1]), joint) if state else (joint,)

    def _finished(self, last: int) -> FormulaFile:
        self._end_section(last)
        if self.believes != (self.odometry is not None):
            lacks = ODOMETRY.title if self.believes else CONTACTS.title
            raise TextError(
                f"contacts and odometry go together; add {lacks!r}, or leave the other out", last, 1
            )
        vocabulary = Vocabulary(self.names, tuple(self.definitions))
        formulas = self.formulas
        if formulas and self.mirror is not None:
            formulas = FormulaMirror.of(vocabulary, self.mirror).complete(formulas)
        shared = any(len(place) == 1 for place in formulas)
        joints = range(quadruped.N_JOINTS)
        states = range(self._n_states if self.names else 0)
        wanted = [(j,) for j in joints] if shared else [(s, j) for s in states for j in joints]
        for place in wanted or [(0,)]:
            if place not in formulas:
                gait = self.header.get("gait")
                if self.machine is None and gait in gait_names():
                    # By a wrong mirror, images that were left out stand elsewhere.
                    self._refuse_other_mirror(shipped_gait(gait))
                where = "" if len(place) == 1 else f" in state {place[0]}"
                joint = quadruped.JOINTS[place[-1]]
                raise TextError(f"the file ends without a formula of {joint}{where}", last, 1)
        ordered = {place: formulas[place] for place in wanted}
        robot = self.header.get("robot", DEFAULT_ROBOT)
        return FormulaFile(
            self.header["gait"],
            vocabulary,
            ordered,
            self.mirror,
            self.law,
            robot,
            self.odometry,
            self.readings,
            self.machine,
        )


def _is_title(line: str) -> bool:
    return (line in (*_ORDER, EVERY_STATE) and line != _FORMULAS) or bool(_SECTION.fullmatch(line))


def _place_of(title: str) -> int:
    """Returns where a section stands in the order of sections."""
    return _ORDER.index(title if title in _ORDER else _FORMULAS)


def _line_of(error: InputError, text: str) -> int | None:
    """Returns the line of the first key that the refusal of a gait's text names, if any."""
    if found := re.match(r"is not valid YAML \(line (\d+):", str(error)):
        return int(found[1])
    lines = key_lines(text)
    named = re.findall(r"\w+(?:\[\d+\])?", str(error))
    return next((lines[name] for name in named if name in lines), None)


def _located(assigned: re.Match[str], line: int, symbols: Sequence[str]) -> Expression:
    """Reads the right side of a statement, and locates its errors in the file."""
    try:
        return parse_formula(assigned[2], symbols)
    except TextError as error:
        shift = assigned.start(2) if error.line == 1 else 0
        raise TextError(str(error), error.line + line - 1, error.column + shift) from error


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Joins lines with the indented ones that follow; yields the number of the first of each."""
    number, statement = 0, ""
    for index, line in enumerate(text.split("\n"), start=1):
        bare = line.partition("#")[0].strip()
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
