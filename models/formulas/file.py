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
those that it holds: `mirror: 1 0` says that state 0 is state 1 in the mirror, and 1 is 0. So must
the gait's machine have it; of one that favours a side files say none. `targets: limited` says that
joints follow the nearest targets within their ranges, where a formula asks for one beyond, and that
these are the last targets that formulas read. `gains: 40 1` says that joints follow with a
stiffness of 40 N·m/rad and a damping of 1 N·m·s/rad, where those are not the robot's own. `robot:
…` names the robot, where it is not the default one. `senses: imu` says that formulas may hold
gravity's direction and the angular velocity. Sections stand in the order in which a robot goes
through them. `contacts` says which feet touch where a sensor seems stuck. `odometry` is the program
by which the robot's velocity and its feet's heights are estimated, with its gain. `machine` is the
gait, as a gait file holds it, whose states are state 0, 1, … in their order. Under `readings` stand
the ranges in which formulas read what is sensed. What stands under `limits` comes last, between
what formulas ask for and the joints. In a file with a mirror image, definitions of one side's legs
may be left out as well.

The grammar of a file, in printable ASCII characters and line feeds. # begins a comment, which ends
with its line; a line that holds no more than spaces and a comment says nothing. A line that begins
with a space goes on with the line before.

    file       = header [ "contacts" program ] [ "odometry" program ] [ "machine" gait ]
                 [ "readings" { kind ":" range { "," range } } ]
                 [ "definitions" { name "=" formula } ] targets [ "limits" program ]
    header     = "format: 1" "gait: " text [ "robot: " text ] "states: " number
                 [ "senses: imu" ] [ "mirror: " { number } ] [ "targets: limited" ]
                 [ "gains: " real real ]
    targets    = "every state" { target } | { "state " number { target } }
    target     = joint "=" formula
    range      = [ name ] real "to" real

Each of these stands at the beginning of a line. What is defined is of observed quantities alone,
and is given once, as is each target. What a formula is, `text.py` says; the programs,
`contacts.py`, `odometry.py` and `limits.py`; ranges, `readings.py`; a gait, `task/gait.py`.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.contacts import CONTACTS
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.limits import LIMITS, limits_lines
from glassgait.models.formulas.mirror import FormulaMirror, Place, completed, without_images
from glassgait.models.formulas.odometry import ODOMETRY, odometry_lines
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.formulas.readings import TITLE as READINGS
from glassgait.models.formulas.readings import Readings, readings_lines
from glassgait.models.formulas.text import written_lines, written_number
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import OWN_LAW, JointLaw
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.task.gait import MACHINE, Gait, gait_lines
from glassgait.models.task.observation import OVERDUE, ObservationLayout, entries_of

FORMAT = 1

SUFFIX = ".formulas"

LIMITED = "limited"
IMU = "imu"

DEFINITIONS = "definitions"
EVERY_STATE = "every state"


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
        machine: The gait itself, where the file holds it.
    """

    gait: str
    vocabulary: Vocabulary
    formulas: Mapping[Place, Expression]
    mirror: tuple[int, ...] | None = None
    joint_law: JointLaw = OWN_LAW
    robot: str = DEFAULT_ROBOT
    odometry: Odometry | None = None
    readings: Readings | None = None
    machine: Gait | None = None

    def with_formulas(self, formulas: Mapping[Place, Expression]) -> "FormulaFile":
        """Returns the file with other formulas, and the definitions that they use."""
        places = sorted(formulas)
        vocabulary, kept = self.vocabulary.using(formulas[place] for place in places)
        whole = dict(zip(places, kept, strict=True))
        return replace(self, vocabulary=vocabulary, formulas=whole)

    def with_written(
        self, definitions: Sequence[Definition], formulas: Mapping[Place, Expression]
    ) -> "FormulaFile":
        """Returns the file that holds others in the place of `written_definitions` and `written`.

        What the file leaves out is the image of what it holds now.
        """
        names, whole = self.vocabulary.names, definitions
        if self.mirror is not None:
            whole = completed(names, self.mirror, definitions)
        vocabulary = Vocabulary(names, tuple(whole))
        if self.mirror is not None:
            formulas = FormulaMirror.of(vocabulary, self.mirror).complete(formulas)
        ordered = {place: formulas[place] for place in self.formulas}
        return replace(self, vocabulary=vocabulary, formulas=ordered)

    @property
    def n_states(self) -> int | None:
        """Number of states that have formulas of their own; none where all share them."""
        places = list(self.formulas)
        return None if len(places[0]) == 1 else 1 + max(place[0] for place in places)

    def written_definitions(self) -> tuple[Definition, ...]:
        """Returns the definitions that the file holds, where it can without those of right legs."""
        given = self.vocabulary.definitions
        return (
            given
            if self.mirror is None
            else without_images(self.vocabulary.names, self.mirror, given)
        )

    def written(self) -> dict[Place, Expression]:
        """Returns the formulas that the file holds: of two that are mirror images the first one.

        Where one alone has the other for its image, it is that one.
        """
        if self.mirror is None:
            return dict(self.formulas)
        mirror = FormulaMirror.of(self.vocabulary, self.mirror)
        pairs = {place: mirror.place(place) for place in self.formulas}
        images = {
            place: self.formulas[place] == mirror.formula(self.formulas[other], other[-1])
            for place, other in pairs.items()
        }
        return {
            place: self.formulas[place]
            for place, other in pairs.items()
            if not images[place] or (images[other] and place < other)
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
    if file.mirror is not None:
        yield from (f"# {line}" for line in _IN_THE_MIRROR)
    yield from _sections_before_formulas(file)
    section = None
    for place in sorted(written):
        title = EVERY_STATE if len(place) == 1 else f"state {place[0]}"
        if title != section:
            yield from ("", title)
            section = title
        yield from formula_lines(file, place)
    if (limits := file.joint_law.limits) is not None:
        yield from ("", LIMITS.title, *limits_lines(limits))


def _sections_before_formulas(file: FormulaFile) -> Iterator[str]:
    if file.odometry is not None:
        yield from ("", CONTACTS.title, *CONTACTS.lines())
        yield from ("", ODOMETRY.title, *odometry_lines(file.odometry))
    if file.machine is not None:
        yield from ("", MACHINE, *(f"# {line}" for line in _MACHINE), *gait_lines(file.machine))
    if file.readings is not None:
        yield from ("", READINGS, *readings_lines(file.readings))
    if file.vocabulary.definitions:
        yield from ("", DEFINITIONS)
    for definition in file.written_definitions():
        start, symbols = f"{definition.symbol} = ", file.vocabulary.symbols
        lines = written_lines(start, definition.formula, symbols)
        note = f"    # {definition.note}" if definition.note else ""
        yield from (*lines[:-1], lines[-1] + note)


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
    yield "# Each formula is the target of a joint, in rad. Greater angles turn a hip to the left,"
    yield "# swing a thigh back, and stretch a knee."
    yield from (f"# {line}" for line in legend)


_GAINS = "N m/rad and N m s/rad; torque of a joint = first*(target - q) - second*dq"
_MIRROR = "states 0, 1, ... in a mirror; what is left out is the image of what is there"
_IN_THE_MIRROR = (
    "In the mirror left and right feet change places, and hips (q, dq, a), cmd.yaw, v.y,",
    "g.y, w.x and w.z their sign.",
)
_MACHINE = (
    "In a state, such as q0, act the formulas of its number. It ends once it has lasted for cmd.t",
    "and feet are as stated: FL in contact; ~FL in the air, with h of the step before at least",
    "clearance. A command names a cmd.t within dwell.",
)

_LEGEND = {
    "commanded velocity": "cmd.v: commanded forward speed, m/s; cmd.yaw: yaw rate, rad/s.",
    "joint position": "q: angle of a joint, rad.",
    "joint velocity": "dq: velocity of a joint, rad/s.",
    "gravity": "g: direction of gravity, forward, left and up.",
    "angular velocity": "w: angular velocity of the trunk, about these axes, rad/s.",
    "previous action": "a: target of a joint at the step before, rad.",
    "machine state": "s0, s1, ...: 1 in that state of the machine, else 0.",
    "iterations": f"t: control steps since the state began, counted up to cmd.t + {OVERDUE:g}.",
    "commanded iterations": "cmd.t: control steps that the state should last.",
    "base velocity": "v: estimated velocity of the trunk, forward, left and up, m/s.",
    "foot height": "h: estimated height of a foot, m.",
}
