"""Formula files: text that a person reads, and that is the policy.

    format: 1
    gait: trot
    states: 2
    mirror: 1 0    # states 0, 1, ... in a mirror; a formula left out is another's mirror image

    # Each formula is the target of a joint, in rad.
    # t: control steps since the state began.

    readings
    v: x -1.4 to 0.9, y -0.9 to 0.9, z -0.7 to 0.5

    definitions
    late = tanh(0.5*t - 2)    # -1 as a state begins

    state 0
    FL_hip = 0.0412 + 0.52*q.FL_hip - 0.013*dq.FL_hip + late*(0.1 - 0.2*cmd.yaw)

A formula is a joint's target in rad. Its names are those of the robot's quantities, in SI units but
for times, which are in control steps, and of what is defined above it. An indented line goes on
with the one before. Formulas that serve all states of the machine stand under `every state`. Where
the file says that the gait has a mirror image, formulas that it leaves out are mirror images of
those that it holds: `mirror: 1 0` says that state 0 is state 1 in the mirror, and 1 is 0. `targets:
limited` says that joints follow the nearest targets within their ranges, where a formula asks for
one beyond, and that these are the last targets that formulas read. `gains: 40 1` says that joints
follow with a stiffness of 40 N·m/rad and a damping of 1 N·m·s/rad, where those are not the robot's
own. `robot: …` names the robot, where it is not the default one. `senses: imu` says that formulas
may hold gravity's direction and the angular velocity, and `odometry` that the robot's velocity and
its feet's heights are estimated by the program that stands there, with its gain. Under `readings`
stand the ranges in which formulas read what is sensed. What stands under `limits` comes last,
between what formulas ask for and the joints.

The grammar of a file, in printable ASCII characters and line feeds. # begins a comment, which ends
with its line; a line that holds no more than spaces and a comment says nothing. A line that begins
with a space goes on with the line before.

    file       = header [ "odometry" program ] [ "readings" { kind ":" range { "," range } } ]
                 [ "definitions" { name "=" formula } ] targets [ "limits" program ]
    header     = "format: 1" "gait: " text [ "robot: " text ] "states: " number
                 [ "senses: imu" ] [ "mirror: " { number } ] [ "targets: limited" ]
                 [ "gains: " real real ]
    targets    = "every state" { target } | { "state " number { target } }
    target     = joint "=" formula
    range      = [ name ] real "to" real

Each of these stands at the beginning of a line. What is defined is of observed quantities alone,
and is given once, as is each target. What a formula is, `text.py` says; the programs, `odometry.py`
and `limits.py`; ranges, `readings.py`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from keyword import iskeyword

from glassgait.models.errors import InputError, shown
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.limits import LIMITS, limits_lines, limits_of
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.odometry import ODOMETRY, odometry_lines
from glassgait.models.formulas.program import Program
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.formulas.readings import TITLE as READINGS
from glassgait.models.formulas.readings import Range, Readings, read_line, readings_lines
from glassgait.models.formulas.text import (
    TextError,
    parse_formula,
    refuse_unprintable,
    written_lines,
    written_number,
)
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.gait_keys import MOST_STATES
from glassgait.models.task.observation import ObservationLayout, entries_of
from glassgait.models.task.odometry import Odometry

FORMAT = 1

SUFFIX = ".formulas"

LIMITED = "limited"
IMU = "imu"

EVERY_STATE = "every state"
DEFINITIONS = "definitions"

_PROGRAMS: dict[str, Program] = {program.title: program for program in (ODOMETRY, LIMITS)}
"""The programs that a file may hold, by the titles of their sections."""

MAX_TEXT = 1_000_000
"""Greatest number of characters of a file."""

MAX_DEFINITIONS = 200

HEADER = ("format", "gait", "robot", "states", "senses", "mirror", "targets", "gains")
"""Keys of a file's header."""

_SECTION = re.compile(r"state (\d{1,3})")
_STATEMENT = re.compile(r"([A-Za-z_][\w.]*) *=(?!=)(.*)", re.DOTALL)
_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)?")


_SAID = {"format": f"'format: {FORMAT}'", "gait": "'gait: trot'", "states": "'states: 2'"}


@dataclass(frozen=True)
class FormulaFile:
    """What a formula file says.

    Attributes:
        gait: Name of the gait.
        vocabulary: What the variables of its formulas are.
        formulas: The formula of each state and joint, or of each joint where it serves all states;
            mirror images included.
        mirror: State that each state is in the mirror; none where no formula has a mirror image.
        joint_law: How joints follow targets.
        robot: Name of the robot; files of the default one leave it out.
        odometry: What estimates the body state; none where that is the expert's estimator.
        readings: In which ranges formulas read what is sensed; in any by default.
    """

    gait: str
    vocabulary: Vocabulary
    formulas: Mapping[Place, Expression]
    mirror: tuple[int, ...] | None = None
    joint_law: JointLaw = OWN_LAW
    robot: str = DEFAULT_ROBOT
    odometry: Odometry | None = None
    readings: Readings | None = None

    def with_formulas(self, formulas: Mapping[Place, Expression]) -> "FormulaFile":
        """Returns the file with other formulas, and the definitions that they use."""
        places = sorted(formulas)
        vocabulary, kept = self.vocabulary.using(formulas[place] for place in places)
        whole = dict(zip(places, kept, strict=True))
        return replace(self, vocabulary=vocabulary, formulas=whole)

    @property
    def n_states(self) -> int | None:
        """Number of states that have formulas of their own; none where all share them."""
        places = list(self.formulas)
        return None if len(places[0]) == 1 else 1 + max(place[0] for place in places)

    def written(self) -> dict[Place, Expression]:
        """Returns the formulas that the file holds, which are no mirror images of ones before."""
        if self.mirror is None:
            return dict(self.formulas)
        mirror = FormulaMirror.of(self.vocabulary, self.mirror)
        return {
            place: formula
            for place, formula in self.formulas.items()
            if place < mirror.place(place)
            or self.formulas[mirror.place(place)] != mirror.formula(formula, place[-1])
        }


def write_formulas(file: FormulaFile) -> str:
    """Writes a formula file.

    Raises:
        InputError: if the observations are not those of the task, of which alone files speak.
    """
    return "\n".join(_lines(file)) + "\n"


def formula_lines(file: FormulaFile, place: Place) -> list[str]:
    """Returns the lines of a formula as its file holds them."""
    start = f"{quadruped.JOINTS[place[-1]]} = "
    return written_lines(start, file.formulas[place], file.vocabulary.symbols)


def _lines(file: FormulaFile) -> Iterator[str]:
    names, written = file.vocabulary.names, file.written()
    layout = ObservationLayout.of(names)
    if names != layout.names:
        raise InputError("a formula file speaks of the task's observations alone, in their order")
    if "#" in file.gait or not (file.gait.isascii() and file.gait.isprintable()):
        raise InputError(
            f"{file.gait!r} cannot stand in a formula file, whose characters are printable ASCII "
            "ones and where # begins a comment; rename the gait"
        )
    yield f"format: {FORMAT}"
    yield f"gait: {file.gait}"
    if file.robot != DEFAULT_ROBOT:
        yield f"robot: {file.robot}"
    yield f"states: {layout.n_machine_states}"
    if layout.imu:
        yield f"senses: {IMU}"
    if file.mirror is not None:
        yield f"mirror: {' '.join(map(str, file.mirror))}    # {_MIRROR}"
    yield from _law_lines(file.joint_law)
    yield ""
    held = [*(definition.formula for definition in file.vocabulary.definitions), *written.values()]
    yield from _legend(held, names)
    if file.odometry is not None:
        yield from ("", ODOMETRY.title, *odometry_lines(file.odometry))
    if file.readings is not None:
        yield from ("", READINGS, *readings_lines(file.readings))
    if file.vocabulary.definitions:
        yield from ("", DEFINITIONS)
    for definition in file.vocabulary.definitions:
        start, symbols = f"{definition.symbol} = ", file.vocabulary.symbols
        lines = written_lines(start, definition.formula, symbols)
        note = f"    # {definition.note}" if definition.note else ""
        yield from (*lines[:-1], lines[-1] + note)
    section = None
    for place in sorted(written):
        title = EVERY_STATE if len(place) == 1 else f"state {place[0]}"
        if title != section:
            yield from ("", title)
            section = title
        yield from formula_lines(file, place)
    if (limits := file.joint_law.limits) is not None:
        yield from ("", LIMITS.title, *limits_lines(limits))


def _law_lines(law: JointLaw) -> Iterator[str]:
    if law.limited:
        yield f"targets: {LIMITED}"
    if law.gains is not None:
        yield f"gains: {' '.join(map(written_number, law.gains))}    # {_GAINS}"


def _legend(formulas: Iterable[Expression], names: tuple[str, ...]) -> Iterator[str]:
    """Explains the quantities that formulas and definitions hold, with their units."""
    used = frozenset().union(*(formula.variables for formula in formulas))
    entries = entries_of(names)
    legend = dict.fromkeys(
        _LEGEND[entries[index].group] for index in sorted(used) if index < len(entries)
    )
    yield "# Each formula is the target of a joint, in rad."
    yield from (f"# {line}" for line in legend)


_GAINS = "of the joints, N m/rad and N m s/rad"
_MIRROR = "states 0, 1, ... in a mirror; a formula left out is another's mirror image"

_LEGEND = {
    "commanded velocity": "cmd.v: commanded forward speed, m/s; cmd.yaw: yaw rate, rad/s.",
    "joint position": "q: angle of a joint, rad.",
    "joint velocity": "dq: velocity of a joint, rad/s.",
    "gravity": "g: direction of gravity, forward, left and up.",
    "angular velocity": "w: angular velocity of the trunk, about these axes, rad/s.",
    "previous action": "a: target of a joint at the step before, rad.",
    "machine state": "s0, s1, ...: 1 in that state of the machine, else 0.",
    "iterations": "t: control steps since the state began.",
    "commanded iterations": "cmd.t: control steps that the state should last.",
    "base velocity": "v: estimated velocity of the trunk, forward, left and up, m/s.",
    "foot height": "h: estimated height of a foot, m.",
}


def read_formulas(text: str) -> FormulaFile:
    """Reads a formula file.

    Raises:
        InputError: if the text is none; the message begins with line and column.
    """
    try:
        return _Reader().read(text)
    except TextError as error:
        raise InputError(f"line {error.line}, column {error.column}: {error}") from error


@dataclass
class _Reader:
    """Takes a text line by line."""

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
    odometry: Odometry | None = None
    ranges: dict[str, Range] = field(default_factory=dict)
    readings: Readings | None = None
    section: str = ""

    def read(self, text: str) -> FormulaFile:
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
                "'every state', 'definitions', 'odometry', 'readings', 'limits', or a header such "
                "as 'gait: trot'",
                line,
                1,
            )

    def _begin(self, title: str, line: int) -> None:
        if not self.section:
            self._take_header(line)
        elif title == ODOMETRY.title:
            raise TextError("odometry stands before all else but the header; move it up", line, 1)
        elif title == READINGS and self.section != ODOMETRY.title:
            raise TextError("readings stand before definitions and formulas; move them up", line, 1)
        elif title == DEFINITIONS and self.section not in (ODOMETRY.title, READINGS):
            raise TextError("definitions stand before all formulas; move them up", line, 1)
        elif self.section == LIMITS.title:
            raise TextError("limits come last; move them down", line, 1)
        self._end_section(line)
        if title == LIMITS.title:
            self.section = title
            return
        state = _SECTION.fullmatch(title)
        if state and int(state[1]) >= self._n_states:
            raise TextError(f"there are states 0 to {self._n_states - 1}; name one", line, 7)
        shared = {len(place) == 1 for place in self.formulas}
        if shared and shared != {title == EVERY_STATE}:
            raise TextError(
                f"formulas serve {EVERY_STATE!r} or one state each, not both; choose", line, 1
            )
        self.section = title

    def _take_ranges(self, text: str, line: int) -> None:
        for kind, ends in read_line(text, line).items():
            if kind in self.ranges:
                raise TextError(f"{kind} has a range above; leave one out", line, 1)
            self.ranges[kind] = ends

    def _end_section(self, line: int) -> None:
        if self.section == READINGS:
            try:
                self.readings = Readings(tuple(self.ranges.items()))
                self.readings.refuse_others(self.names)
            except InputError as error:
                raise TextError(str(error), line, 1) from error
        program = _PROGRAMS.get(self.section)
        if program is None:
            return
        program.refuse_end(self.n_statements, line)
        if program is ODOMETRY:
            self.odometry = Odometry(gain=self.program["GAIN"])
        else:
            self.law = replace(self.law, limits=limits_of(self.program))
        self.program, self.n_statements = {}, 0

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
        try:
            stiffness, damping = map(float, self.header["gains"].split())
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
        if len(self.definitions) >= MAX_DEFINITIONS:
            raise TextError(f"there are more than {MAX_DEFINITIONS} definitions", line, 1)
        note = text.rstrip().rsplit("\n", maxsplit=1)[-1].partition("#")[2].strip()
        self.definitions.append(Definition(name, formula, note))

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
        vocabulary = Vocabulary(self.names, tuple(self.definitions))
        formulas = self.formulas
        if formulas and self.mirror is not None:
            try:
                formulas = FormulaMirror.of(vocabulary, self.mirror).complete(formulas)
            except InputError as error:
                raise TextError(str(error), last, 1) from error
        shared = any(len(place) == 1 for place in formulas)
        joints = range(quadruped.N_JOINTS)
        states = range(self._n_states if self.names else 0)
        wanted = [(j,) for j in joints] if shared else [(s, j) for s in states for j in joints]
        for place in wanted or [(0,)]:
            if place not in formulas:
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
        )


def _is_title(line: str) -> bool:
    return line in (*_PROGRAMS, READINGS, DEFINITIONS, EVERY_STATE) or bool(
        _SECTION.fullmatch(line)
    )


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
