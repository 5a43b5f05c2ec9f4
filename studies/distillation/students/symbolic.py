"""Students of formulas: one for each joint, or one for each joint and state of the machine.

They are fitted as they are written: in the robot's units, with three digits.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.box import measured_box
from glassgait.models.formulas.expression import Expression, canonical, constant
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.quantities import (
    COURSE,
    GATES,
    SENT_JOINTS,
    RobotUnits,
    Vocabulary,
    known_definitions,
)
from glassgait.models.formulas.readings import Readings
from glassgait.models.formulas.tape import Tape
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import indices_of
from glassgait.studies.distillation.students.formula_samples import (
    FormulaSamples,
    samples_by_state,
    samples_of_joints,
)
from glassgait.studies.distillation.students.student import Student, TrainingSet
from glassgait.studies.distillation.students.symbolic_regression import (
    StatewiseSymbolicSettings,
    SymbolicSettings,
    fit_formulas,
)

DIGITS = 3
"""Significant digits of the numbers in formulas."""


def gates(vocabulary: Vocabulary) -> tuple[Expression, ...]:
    """Returns the gates of formulas that serve one state of the machine.

    They say where in the gait the robot is, which way its joints were last sent and, as far as it
    is observed, which course it takes.
    """
    course = (symbol for symbol in COURSE if symbol in vocabulary.symbols)
    return tuple(vocabulary.variable(symbol) for symbol in (*GATES, *SENT_JOINTS, *course))


def shared_gates(vocabulary: Vocabulary) -> tuple[Expression, ...]:
    """Returns the gates of formulas that serve every state of the machine.

    They are the gates of one state, the states but the last, which is where all others are 0, and
    whether the robot is late in each state.
    """
    symbols = [vocabulary.symbols[i] for i in indices_of("machine state", vocabulary.names)]
    states = [vocabulary.variable(symbol) for symbol in symbols[:-1]]
    late, *others = gates(vocabulary)
    products = (Expression("mul", (state, late)) for state in states)
    return (*states, late, *products, *others)


class FormulaFit:
    """Fits formulas of joint targets.

    Attributes:
        vocabulary: What the formulas may hold.
    """

    def __init__(
        self,
        robot: Robot,
        names: tuple[str, ...],
        gates: Callable[[Vocabulary], Sequence[Expression]],
    ) -> None:
        """
        Args:
            names: Names of the observations (n).
            gates: Returns what says where in the gait the robot is.
        """
        self.vocabulary = Vocabulary(names, known_definitions(robot, names))
        self._gates = gates(self.vocabulary)
        self._units = RobotUnits.of(robot, names)

    def values(self, observations: Array) -> Array:
        """Evaluates all variables (m, k) on observations (m, n)."""
        observed = self._units.quantities(observations)
        definitions = [definition.formula for definition in self.vocabulary.definitions]
        return np.hstack([observed, Tape(definitions, observed.shape[1])(observed)])

    def __call__(
        self, part: FormulaSamples, seed: int, settings: SymbolicSettings, n_jobs: int = 1
    ) -> list[Expression]:
        """Fits the formula of each place.

        Args:
            part: Samples, and what the formulas should be there.
            seed: Seed of the search.
            settings: Engine and budget; of several shapes the first counts.
            n_jobs: Formulas that are searched at once.

        Raises:
            InputError: if the engine is PySR and Julia cannot start, or its search fails.
        """
        values, n = self.values(part.observations), part.observations.shape[1]
        formulas = fit_formulas(values, part.targets, seed, settings, self._gates, n, n_jobs)
        return readable(formulas, values, part.targets)

    def policy(
        self, gait: str, formulas: Mapping[Place, Expression], mirror: tuple[int, ...] | None = None
    ) -> FormulaPolicy:
        """Returns the policy that acts by formulas and, with a mirror, by their images.

        Definitions that none uses are left out.
        """
        if mirror is not None:
            formulas = FormulaMirror.of(self.vocabulary, mirror).complete(formulas)
        robot = self._units.robot
        file = FormulaFile(gait, self.vocabulary, formulas, mirror, robot=robot.name)
        return FormulaPolicy.from_file(file.with_formulas(formulas), robot)


def readings_of(gait: Gait, robot: Robot, names: tuple[str, ...], observations: Array) -> Readings:
    """Returns the ranges in which formulas are to read: those of samples, and a margin.

    Args:
        gait: The gait.
        robot: The robot.
        names: Names of the observations (n).
        observations: Samples (m, n).
    """
    box = measured_box(gait, robot, names, observations.min(axis=0), observations.max(axis=0))
    return Readings.around(names, box.lower, box.upper)


def settled(formula: Expression, names: Sequence[str], state: int) -> Expression:
    """Puts what is known in a state of the machine, which state it is, into a formula.

    Args:
        names: Names of the observations, of the formula's first variables.
        state: Index of the state.
    """
    known = {index: float(i == state) for i, index in enumerate(indices_of("machine state", names))}
    return _settled(formula, known)


def _settled(formula: Expression, known: Mapping[int, float]) -> Expression:
    if formula.operator == "variable" and formula.variable in known:
        return constant(known[formula.variable])
    if known.keys().isdisjoint(formula.variables):
        return formula
    operands = tuple(_settled(operand, known) for operand in formula.operands)
    if formula.operator == "mul" and all(own.operator == "constant" for own in operands):
        return constant(operands[0].value * operands[1].value)
    return Expression(formula.operator, operands)


def readable(formulas: Sequence[Expression], values: Array, targets: Array) -> list[Expression]:
    """Rounds formulas to the digits that are shown, and sets their constants right.

    Args:
        formulas: The formulas (k).
        values: Samples of all variables (m, n).
        targets: What the formulas are fitted to (m, k).
    """
    short = [rounded(formula) for formula in formulas]
    bias = (targets - Tape(short, values.shape[1])(values)).mean(axis=0)
    return [rounded(_raised(formula, float(b))) for formula, b in zip(short, bias, strict=True)]


def rounded(formula: Expression, digits: int = DIGITS) -> Expression:
    """Rounds the numbers of a formula to so many significant digits, in canonical form."""
    return canonical(_rounded(formula, digits))


def short_numbers(policy: FormulaPolicy) -> FormulaPolicy:
    """Rounds the numbers of all formulas of a policy to the digits that are shown."""
    file = policy.to_file()
    formulas = {place: rounded(formula) for place, formula in file.formulas.items()}
    return FormulaPolicy.from_file(replace(file, formulas=formulas), policy.robot)


def _rounded(formula: Expression, digits: int) -> Expression:
    if formula.operator == "constant":
        return constant(float(f"{formula.value:.{digits}g}"))
    if not formula.operands:
        return formula
    operands = tuple(_rounded(operand, digits) for operand in formula.operands)
    return Expression(formula.operator, operands)


def _raised(formula: Expression, by: float) -> Expression:
    """Adds a number to the constant that a sum begins with, if it begins with one."""
    match formula:
        case Expression("constant", value=value):
            return constant(value + by)
        case Expression(("add" | "sub") as operator, (left, right)):
            return Expression(operator, (_raised(left, by), right))
        case _:
            return formula


def _fit(
    samples: TrainingSet, settings: SymbolicSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    """Fits a formula for each joint."""
    fit = FormulaFit(samples.robot, samples.observation_names, shared_gates)
    found = fit(samples_of_joints(_weighted(samples, settings)), seed, settings, n_jobs)
    return fit.policy(samples.gait, {(joint,): own for joint, own in enumerate(found)})


def _fit_statewise(
    samples: TrainingSet, settings: StatewiseSymbolicSettings, *, seed: int, n_jobs: int
) -> FormulaPolicy:
    """Fits a formula for each joint and state of the machine, or for half of them and a mirror."""
    names, mirror = samples.observation_names, samples.mirror if settings.mirrored else None
    fit = FormulaFit(samples.robot, names, gates)
    formulas: dict[Place, Expression] = {}
    for part in samples_by_state(_weighted(samples, settings), fit.vocabulary, mirror):
        found = fit(part, seed, settings, n_jobs)
        formulas |= {
            place: settled(own, names, place[0])
            for place, own in zip(part.places, found, strict=True)
        }
    return fit.policy(samples.gait, formulas, mirror)


def _weighted(samples: TrainingSet, settings: SymbolicSettings) -> TrainingSet:
    """Lets samples of an episode's start count as often as settings say."""
    counts = np.where(samples.starts, settings.start_weights[0], 1)
    return samples.subset(np.repeat(np.arange(len(counts)), counts))


SYMBOLIC = Student(
    "symbolic",
    "Symbolic",
    _fit,
    color="#009E73",
    marker="D",
    settings=SymbolicSettings(),
    brevity=2,
    paper_r2={"walk": 0.6811, "trot": 0.7334, "pace": 0.7331, "bound": 0.6564},
)

STATEWISE_SYMBOLIC = Student(
    "statewise_symbolic",
    "Symbolic per RM state",
    _fit_statewise,
    color="#B8609A",
    marker="P",
    settings=StatewiseSymbolicSettings(),
    brevity=3,
)
