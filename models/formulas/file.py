"""Formula files: readable text that defines a policy.

    format: 2
    gait: trot
    states: 2
    mirror: [1, 0]    # state 0 is state 1 in a mirror; left-out formulas are mirror images

    definitions
    late = tanh(0.5*t - 2)    # -1 as a state begins

    state 0
    FL_hip = 0.0412 + 0.52*q.FL_hip - 0.013*dq.FL_hip + late*(0.1 - 0.2*cmd.yaw)

The header is YAML; `models/README.md` lists its keys. Definitions follow, then the targets.

A formula is a joint's target in rad. It uses the robot's quantities, in SI units except for times,
which are in control steps, and the definitions. A definition uses only the robot's quantities.
Formulas are under `state 0`, `state 1`, ..., or all under `every state`. With a `mirror`, a file
may leave out formulas, and definitions of right legs, that are mirror images of others in it.

Below the header, # begins a comment, and a line that begins with a space continues the previous
one. Files contain only printable ASCII characters and line feeds:

    formulas   = [ "definitions" { name "=" formula } ] targets
    targets    = "every state" { target } | { "state " number { target } }
    target     = joint "=" formula

`grammar.py` describes formulas. `latex.py` writes out the odometry and limits of the header.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf

import yaml

from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.grammar import written_lines, written_number
from glassgait.models.formulas.mirror import FormulaMirror, Place, without_images
from glassgait.models.formulas.quantities import Readings, Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import DEFAULT_LAW, DEFAULT_ROBOT, JointLaw
from glassgait.models.task.gait import Gait, gait_lines
from glassgait.models.task.observation import OVERDUE, ObservationLayout, entries_of

FORMAT = 2

SUFFIX = ".formulas"

DEFINITIONS = "definitions"
EVERY_STATE = "every state"


@dataclass(frozen=True)
class FormulaFile:
    """The content of a formula file.

    Attributes:
        formulas: Formula of each state and joint, or of each joint if all states share it;
            mirror images included.
        mirror: Mirror image of each state; None if the file has no mirror images.
        odometry: Estimator of the body state; None if the expert's network estimates it.
        readings: Ranges that quantities are clipped to; None for unlimited ones.
        machine: The gait, if the file contains it.
    """

    gait: str
    vocabulary: Vocabulary
    formulas: Mapping[Place, Expression]
    mirror: tuple[int, ...] | None = None
    joint_law: JointLaw = DEFAULT_LAW
    robot: str = DEFAULT_ROBOT
    odometry: Odometry | None = None
    readings: Readings | None = None
    machine: Gait | None = None

    def with_formulas(self, formulas: Mapping[Place, Expression]) -> "FormulaFile":
        """Returns the file with other formulas, and the definitions that they use."""
        places = sorted(formulas)
        vocabulary, values = self.vocabulary.using(formulas[place] for place in places)
        return replace(self, vocabulary=vocabulary, formulas=dict(zip(places, values, strict=True)))

    def with_written(self, formulas: Mapping[Place, Expression]) -> "FormulaFile":
        """Returns the file with the formulas of `written` replaced, and their mirror images."""
        if self.mirror is not None:
            formulas = FormulaMirror.of(self.vocabulary, self.mirror).complete(formulas)
        return replace(self, formulas={place: formulas[place] for place in self.formulas})

    @property
    def n_states(self) -> int | None:
        """Number of states with their own formulas; None if all states share them."""
        places = list(self.formulas)
        return None if len(places[0]) == 1 else 1 + max(place[0] for place in places)

    def variables(self) -> frozenset[int]:
        """Returns the indices of all variables that formulas and definitions use."""
        defined = (definition.formula for definition in self.vocabulary.definitions)
        formulas = (*defined, *self.formulas.values())
        return frozenset().union(*(formula.variables for formula in formulas))

    def written(self) -> dict[Place, Expression]:
        """Returns the formulas that the file's text contains: one of each mirror pair."""
        if self.mirror is None:
            return dict(self.formulas)
        # A formula that is no exact image is written as well.
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
    return "\n".join([*header_lines(file), *_formulas(file)]) + "\n"


def formula_lines(file: FormulaFile, place: Place) -> list[str]:
    """Returns the lines of a formula as written in a file."""
    start = f"{quadruped.JOINTS[place[-1]]} = "
    return written_lines(start, file.formulas[place], file.vocabulary.symbols)


def header_lines(file: FormulaFile) -> Iterator[str]:
    """Writes a file's header."""
    law, layout = file.joint_law, ObservationLayout.of(file.vocabulary.names)
    # The gait, the robot and its sensors.
    yield f"format: {FORMAT}"
    yield _text("gait", file.gait)
    if file.robot != DEFAULT_ROBOT:
        yield _text("robot", file.robot)
    yield f"states: {layout.n_machine_states}"
    if layout.imu:
        yield "senses: imu"
    if file.mirror is not None:
        yield f"mirror: {[*file.mirror]}    # {_MIRROR}"
    # The joint law and the estimator.
    if law.gains is not None:
        yield f"gains: {_list(law.gains)}    # {_GAINS}"
    if law.limited and law.limits is None:
        yield "limited: true    # targets are clipped to the joints' ranges"
    if (limits := law.limits) is not None:
        numbers = {"stiffness": limits.stiffness, "margin": limits.margin, "lean": limits.lean}
        yield f"limits: {_mapping(numbers)}    # {_LIMITS}"
    if file.odometry is not None:
        yield f"odometry: {_mapping({'gain': file.odometry.gain})}    # {_ODOMETRY}"
    # The reward machine and the ranges of quantities.
    if file.machine is not None:
        yield "machine:"
        yield from (f"  {line}" for line in [*_MACHINE, *gait_lines(file.machine)])
    if file.readings is not None:
        yield f"readings:{'' if file.readings.ranges else ' {}'}"
        yield from (f"  {line}" for line in _READINGS)
        yield from (f"  {kind}: {_list(ends)}" for kind, ends in file.readings.ranges)


def _formulas(file: FormulaFile) -> Iterator[str]:
    # Explain only the quantities that are used.
    entries, used = entries_of(file.vocabulary.names), file.variables()
    groups = dict.fromkeys(entry.group for i, entry in enumerate(entries) if i in used)
    yield from ("", *_TARGETS, *(f"# {_QUANTITIES[group]}" for group in groups))
    if file.mirror is not None:
        yield from _IN_THE_MIRROR
    # Write the definitions without mirror images, then the formulas of each state.
    definitions = file.vocabulary.definitions
    if definitions:
        yield from ("", DEFINITIONS)
    if file.mirror is not None:
        definitions = without_images(file.vocabulary.names, file.mirror, definitions)
    for definition in definitions:
        start, symbols = f"{definition.symbol} = ", file.vocabulary.symbols
        lines = written_lines(start, definition.formula, symbols)
        note = f"    # {definition.note}" if definition.note else ""
        yield from (*lines[:-1], lines[-1] + note)
    # Put a title before the first formula of each section.
    section = None
    for place in sorted(file.written()):
        title = EVERY_STATE if len(place) == 1 else f"state {place[0]}"
        if title != section:
            yield from ("", title)
            section = title
        yield from formula_lines(file, place)


def _text(key: str, value: str) -> str:
    return yaml.safe_dump({key: value}, width=inf).strip()


def _list(numbers: Iterable[float | tuple[float, ...]]) -> str:
    written = (_list(item) if isinstance(item, tuple) else _number(item) for item in numbers)
    return f"[{', '.join(written)}]"


def _mapping(numbers: Mapping[str, float]) -> str:
    return f"{{{', '.join(f'{key}: {_number(value)}' for key, value in numbers.items())}}}"


def _number(value: float) -> str:
    """Writes a number for YAML, which would read 1e-05 as text."""
    text = written_number(value)
    return text if "." in text else text.replace("e", ".0e")


_MIRROR = "state 0, 1, ... in a mirror; what is left out is the image of what is there"
_GAINS = "N m/rad, N m s/rad; torque of a joint = first*(target - q) - second*dq"
_LIMITS = "N m/rad, rad, degrees: they come last"
_ODOMETRY = "above 0, up to 1; 'glassgait explain formulas' shows both programs"
_TARGETS = (
    "# Each formula is the target of a joint, in rad. Greater angles turn a hip to the left,",
    "# swing a thigh back, and stretch a knee.",
)
_IN_THE_MIRROR = (
    "# In the mirror left and right feet change places, and hips (q, dq, a), cmd.yaw, v.y,",
    "# g.y, w.x and w.z their sign.",
)
_MACHINE = (
    "# In a state, such as q0, act the formulas of its number. It ends once it has lasted for",
    "# cmd.t and feet are as stated: FL in contact; ~FL in the air, with h of the step before at",
    "# least clearance. A command names a cmd.t within dwell.",
)
_READINGS = (
    "# Formulas read each within its range, and the nearer end where a sensor says more. Of right",
    "# hips, whose angles have the other sign, the range is that of left ones in the mirror.",
)
_QUANTITIES = {
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
