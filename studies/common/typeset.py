"""Typeset controllers: all that a formula file says, as LaTeX."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from glassgait.models.formulas.contacts import CONTACTS
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.limits import LIMITS
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.odometry import ODOMETRY
from glassgait.models.formulas.program import Program
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.formulas.text import write_formula, written_number
from glassgait.models.formulas.typeset import Latex, Markup, Typesetter
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.drawing import COLORS, state_colors
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import entries_of
from glassgait.studies.common.pages import SHARED_TEMPLATES, page_template

PIECES_OF_A_LINE = 4
"""Pieces of a formula in a line of LaTeX."""

_DEFINED = {"late": r"\ell", "phase": r"\varphi", "e.v": "e_v"}
_OF_LEGS = {"lifted": "u", "x": "x", "z": "z"}

_PROGRAM_SYMBOLS = {"dp": r"\dot p", "dr": r"\dot r", "w": r"\omega"}
"""Symbols of quantities of the programs, which have no axes: vectors in the trunk's frame."""


StateJoint = tuple[int | None, str]
"""State of the machine, none where a formula serves all, and joint."""


def symbols_of(vocabulary: Vocabulary) -> dict[str, str]:
    """Returns the symbol of each variable of formulas, as LaTeX."""
    observed = {entry.symbol: entry.latex for entry in entries_of(vocabulary.names)}
    return observed | {own.symbol: _defined(own.symbol) for own in vocabulary.definitions}


def _defined(symbol: str) -> str:
    kind, _, of = symbol.partition(".")
    if of in quadruped.LEGS and kind in _OF_LEGS:
        return rf"{_OF_LEGS[kind]}_{{\mathrm{{{of}}}}}"
    if of in quadruped.JOINTS and kind == "sent":
        return rf"\sigma_{{\mathrm{{{joint_title(of)}}}}}"
    return _DEFINED.get(symbol) or rf"\mathrm{{{symbol}}}".replace("_", r"\_")


def joint_title(joint: str) -> str:
    """Writes a joint's name as an index; LaTeX loses plain spaces there."""
    return joint.replace("_", r"\,")


@dataclass(frozen=True)
class Statement:
    """A line of a controller, typeset.

    Attributes:
        left: What it gives.
        relation: What stands between.
        pieces: What that is; a line may end between two pieces.
        note: What it means, in words.
    """

    left: str
    relation: str
    pieces: list[str]
    note: str = ""

    @property
    def lines(self) -> list[str]:
        """Lines of a few pieces each."""
        starts = range(0, len(self.pieces), PIECES_OF_A_LINE)
        return ["".join(self.pieces[start : start + PIECES_OF_A_LINE]) for start in starts]


@dataclass(frozen=True)
class Target:
    """The formula of a joint, typeset.

    Attributes:
        state: State of the machine that it acts in; none where it acts in all.
        joint: The joint.
        statement: The formula.
        image_of: Where the file holds the formula that this one is the mirror image of, as state
            and joint; none where the file holds this one.
        n_terms: Number of its terms, brackets multiplied out.
    """

    state: int | None
    joint: str
    statement: Statement
    image_of: StateJoint | None
    n_terms: int


@dataclass(frozen=True)
class Symbol:
    """A symbol of formulas.

    Attributes:
        typeset: The symbol.
        name: What the file calls it.
        meaning: What it is, in words, with its unit.
    """

    typeset: str
    name: str
    meaning: str


@dataclass(frozen=True)
class TypesetController:
    """What a formula file says, in one language.

    Attributes:
        file: The file.
        markup: The language.
        robot: The robot whose joints follow the targets.
    """

    file: FormulaFile
    markup: Markup
    robot: Robot

    @cached_property
    def _setter(self) -> Typesetter:
        return Typesetter(self.markup, symbols_of(self.file.vocabulary))

    def name(self, name: str) -> str:
        """Typesets the symbol of a name."""
        return self._setter.name(name)

    def programs(self) -> Iterator[tuple[Program, list[Statement]]]:
        """Typesets which contacts are believed, and odometry; none where the file holds none."""
        odometry = self.file.odometry
        if odometry is not None:
            yield CONTACTS, self._program(CONTACTS, {})
            yield ODOMETRY, self._program(ODOMETRY, {"GAIN": written_number(odometry.gain)})

    def limits(self) -> tuple[Program, list[Statement]] | None:
        """Typesets what stands between formulas and joints; none where nothing does."""
        limits = self.file.joint_law.limits
        if limits is None:
            return None
        numbers = {
            "STIFFNESS": written_number(limits.stiffness),
            # Of the one angle in degrees the sign must be seen.
            "LEAN": rf"{written_number(limits.lean)}^{{\circ}}",
            "MARGIN": written_number(limits.margin),
        }
        return LIMITS, self._program(LIMITS, numbers)

    def torque(self) -> Statement:
        """Typesets the law by which a joint's motor follows its target."""
        stiffness, damping = map(written_number, self.file.joint_law.gains_of(self.robot))
        symbols = {"torque": r"\tau", "target": "q^{*}", "q": "q", "dq": r"\dot q"}
        setter = Typesetter(self.markup, symbols)
        law = setter.pieces(f"{stiffness}*(target - q) - {damping}*dq")
        return Statement(setter.name("torque"), setter.relation("0"), law)

    def joints(self) -> list[tuple[str, ...]]:
        """Returns name, ends of the range, default stance and greatest torque of left joints."""
        robot = self.robot
        numbers = (robot.lower_limits, robot.upper_limits, robot.default_stance, robot.effort)
        return [
            (joint.replace("_", " "), *(f"{row[index]:.4g}".replace("-", "−") for row in numbers))
            for index, joint in enumerate(quadruped.JOINTS)
            if joint[1] == "L"
        ]

    def legend(self, program: Program) -> list[tuple[str, str]]:
        """Typesets a program's quantities: the symbol of each, and the words after it."""
        setter = Typesetter(self.markup, _PROGRAM_SYMBOLS)
        return [(setter.name(name), words) for name, words in program.quantities()]

    def _program(self, program: Program, numbers: Mapping[str, str]) -> list[Statement]:
        setter = Typesetter(self.markup, {**_PROGRAM_SYMBOLS, "g.z": "g_z", **numbers})
        return [
            Statement(setter.name(name), setter.relation(text), setter.pieces(text), note)
            for statement, note in program.statements
            for name, _, text in [statement.partition(" = ")]
        ]

    def transitions(self, machine: Gait) -> list[tuple[str, str, str]]:
        """Typesets the machine's edges: the state that each leaves and enters, and when."""
        return [
            (edge.source, edge.target, self._setter.whole(edge.when.text))
            for edge in machine.transitions
        ]

    def ranges(self) -> list[tuple[str, str, str]]:
        """Returns what formulas read within a range: its name in the file, and the ends."""
        readings = self.file.readings
        return [
            (kind, written_number(low).replace("-", "−"), written_number(high).replace("-", "−"))
            for kind, (low, high) in (() if readings is None else readings.ranges)
        ]

    def symbols(self) -> list[Symbol]:
        """Typesets the symbols of what is observed and used, one of each kind."""
        entries = entries_of(self.file.vocabulary.names)
        used = frozenset().union(*(formula.variables for formula in self._formulas()))
        kinds: dict[str, Symbol] = {}
        for index, entry in enumerate(entries):
            if index in used:
                kind = entry.symbol if entry.leg is None else entry.symbol.split(".")[0]
                unit = f", {entry.unit}" if entry.unit else ""
                meaning = f"{_MEANINGS.get(kind, entry.group)}{unit}"
                kinds.setdefault(
                    kind, Symbol(self._setter.name(entry.symbol), entry.symbol, meaning)
                )
        return list(kinds.values())

    def definitions(self) -> list[Statement]:
        """Typesets what the file defines, that of right legs too."""
        return [
            self._statement(own.symbol, own.formula, own.note)
            for own in self.file.vocabulary.definitions
        ]

    def targets(self) -> list[list[Target]]:
        """Typesets the formulas of all joints, a list a state of the machine.

        Mirror images are there in full, and name what they are images of.
        """
        images = image_places(self.file)
        states: dict[int | None, list[Target]] = {}
        for place in sorted(self.file.formulas):
            state, joint = _place(place)
            image = images.get((state, joint))
            n_terms = len(self.file.formulas[place].terms())
            target = Target(state, joint, self.formula(place), image, n_terms)
            states.setdefault(state, []).append(target)
        return list(states.values())

    def formula(self, place: Place) -> Statement:
        """Typesets one formula of the file, or that of a mirror image."""
        left = rf"q^{{*}}_{{\mathrm{{{joint_title(quadruped.JOINTS[place[-1]])}}}}}"
        pieces = self._pieces(self.file.formulas[place])
        return Statement(self.markup.symbol(left), self._setter.relation("0"), pieces)

    def _statement(self, name: str, formula: Expression, note: str) -> Statement:
        relation = self._setter.relation("0")
        return Statement(self._setter.name(name), relation, self._pieces(formula), note)

    def _pieces(self, formula: Expression) -> list[str]:
        return self._setter.pieces(write_formula(formula, self.file.vocabulary.symbols))

    def _formulas(self) -> list[Expression]:
        defined = [own.formula for own in self.file.vocabulary.definitions]
        return [*defined, *self.file.formulas.values()]


def image_places(file: FormulaFile) -> dict[StateJoint, StateJoint]:
    """Returns, of formulas that a file leaves out, where those stand that they are images of."""
    if file.mirror is None:
        return {}
    mirror, held = FormulaMirror.of(file.vocabulary, file.mirror), file.written()
    return {
        _place(place): _place(mirror.place(place)) for place in file.formulas if place not in held
    }


def _place(place: Place) -> StateJoint:
    *state, joint = place
    return (state[0] if state else None), quadruped.JOINTS[joint]


_MEANINGS = {
    "cmd.v": "commanded forward speed",
    "cmd.yaw": "commanded yaw rate",
    "cmd.t": "steps that the state should last, as commanded",
    "t": "steps since the state began",
    "g.x": "gravity's direction, forward",
    "g.y": "gravity's direction, to the left",
    "g.z": "gravity's direction, up",
    "w.x": "angular velocity of the trunk about its forward axis",
    "w.y": "angular velocity of the trunk about its left axis",
    "w.z": "angular velocity of the trunk about its upward axis",
    "v.x": "estimated velocity of the trunk, forward",
    "v.y": "estimated velocity of the trunk, to the left",
    "v.z": "estimated velocity of the trunk, up",
    "q": "angle of a joint",
    "dq": "velocity of a joint",
    "a": "target of a joint at the step before",
    "h": "estimated height of a foot",
}
"""What observations are, where their group does not say it all."""


def to_latex(file: FormulaFile, robot: Robot) -> str:
    """Writes all that a formula file says as a LaTeX document."""
    return _rendered("typeset.tex", file, robot, Latex(), {})


def _rendered(
    template: str, file: FormulaFile, robot: Robot, markup: Markup, shown: Mapping[str, object]
) -> str:
    controller = TypesetController(file, markup, robot)
    return page_template(SHARED_TEMPLATES, template).render(
        file=file,
        controller=controller,
        by_leg=joints_by_leg,
        n_written=len(file.written()),
        colors=state_colors(file.machine) if file.machine else COLORS,
        **shown,
    )


def joints_by_leg(targets: Sequence[Target]) -> dict[str, list[Target]]:
    """Returns the targets of a state as rows, a leg each."""
    return {
        leg: [target for target in targets if target.joint.startswith(leg)]
        for leg in quadruped.LEGS
    }
