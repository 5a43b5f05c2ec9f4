"""Students of formulas: one for each joint, or one for each joint and state of the machine.

They are fitted as they are written: in the robot's units, with three digits.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.observation_box import measured_box
from glassgait.models.formulas.expression import Expression, canonical, constant
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.mirror import Place
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
        self,
        observations: Array,
        actions: Array,
        seed: int,
        settings: SymbolicSettings,
        n_jobs: int = 1,
    ) -> list[Expression]:
        """Fits a formula for each joint.

        Args:
            observations: Samples (m, n).
            actions: The expert's actions (m, 12).
            seed: Seed of the search.
            settings: Engine and budget; of several shapes the first counts.
            n_jobs: Formulas that are searched at once.

        Raises:
            InputError: if the engine is PySR and Julia cannot start, or its search fails.
        """
        values, targets = self.values(observations), self._units.robot.joint_targets(actions)
        n = observations.shape[1]
        formulas = fit_formulas(values, targets, seed, settings, self._gates, n, n_jobs)
        return readable(formulas, values, targets)

    def policy(
        self, gait: str, formulas: Mapping[Place, Expression], mirror: tuple[int, ...] | None = None
    ) -> FormulaPolicy:
        """Returns the policy that acts by formulas, without the definitions that none uses."""
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
    return Readings.around(names, *box.quantities)


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
    samples: TrainingSet, settings: SymbolicSettings, *, statewise: bool, seed: int, n_jobs: int
) -> FormulaPolicy:
    """Fits a formula for each joint, or one for each joint and state of the machine."""
    counts = np.where(samples.starts, settings.start_weights[0], 1)
    samples = samples.subset(np.repeat(np.arange(len(counts)), counts))
    names = samples.observation_names
    fit = FormulaFit(samples.robot, names, gates if statewise else shared_gates)
    parts = samples.by_state() if statewise else [np.ones(len(samples.actions), dtype=bool)]
    formulas: dict[Place, Expression] = {}
    for state, mine in enumerate(parts):
        own = fit(samples.observations[mine], samples.actions[mine], seed, settings, n_jobs)
        if statewise:
            own = [settled(formula, names, state) for formula in own]
        formulas |= {
            (state, joint) if statewise else (joint,): formula for joint, formula in enumerate(own)
        }
    return fit.policy(samples.gait, formulas)


SYMBOLIC = Student(
    "symbolic",
    "Symbolic",
    partial(_fit, statewise=False),
    color="#009E73",
    marker="D",
    settings=SymbolicSettings(),
    brevity=2,
    paper_r2={"walk": 0.6811, "trot": 0.7334, "pace": 0.7331, "bound": 0.6564},
)

STATEWISE_SYMBOLIC = Student(
    "statewise_symbolic",
    "Symbolic per RM state",
    partial(_fit, statewise=True),
    color="#B8609A",
    marker="P",
    settings=StatewiseSymbolicSettings(),
    brevity=3,
)
