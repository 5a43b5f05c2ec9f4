"""Fitting of formulas in their written form: robot's units, three digits, mirrored."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.certificates.box import measured_box
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.expression import (
    Expression,
    canonical,
    constant,
    numbers_of,
    with_numbers,
)
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.quantities import (
    GATES,
    Readings,
    RobotUnits,
    Vocabulary,
    known_definitions,
)
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import REFLECT_JOINTS, indices_of, reflect_observation
from glassgait.studies.distillation.dataset import TrainingSet

DIGITS = 3
"""Significant digits of the numbers in formulas."""


def gates(vocabulary: Vocabulary) -> tuple[Expression, ...]:
    """Returns the gates of formulas of one RM state: gait, previous targets, and motion."""
    # An expert's only memory is its previous targets; experts trained on uneven ground use them as
    # switches.
    sent = (f"sent.{joint}" for joint in quadruped.JOINTS)
    # On uneven ground, forward and backward, the commanded speed, sideways drift, slope ahead and
    # pitch rate change the effect of all other observations.
    course = (symbol for symbol in ("cmd.v", "v.y", "g.x", "w.y") if symbol in vocabulary.symbols)
    return tuple(vocabulary.variable(symbol) for symbol in (*GATES, *sent, *course))


def shared_gates(vocabulary: Vocabulary) -> tuple[Expression, ...]:
    """Returns the gates of formulas that are shared by all RM states."""
    # The last state needs no gate: in it, all others are 0.
    symbols = [vocabulary.symbols[i] for i in indices_of("machine state", vocabulary.names)]
    states = [vocabulary.variable(symbol) for symbol in symbols[:-1]]
    late, *others = gates(vocabulary)
    products = (Expression("mul", (state, late)) for state in states)
    return (*states, late, *products, *others)


class FormulaVariables:
    """The variables of formulas: observations in the robot's units, then definitions."""

    def __init__(self, robot: Robot, names: tuple[str, ...]) -> None:
        self.vocabulary = Vocabulary(names, known_definitions(robot, names))
        self._units = RobotUnits.of(robot, names)

    def __call__(self, observations: Array) -> Array:
        """Evaluates all variables (m, k) on observations (m, n)."""
        observed = self._units.quantities(observations)
        definitions = [definition.formula for definition in self.vocabulary.definitions]
        return np.hstack([observed, Tape(definitions, observed.shape[1])(observed)])


@dataclass(frozen=True)
class FormulaSamples:
    """Observations (m, n) and targets (m, k; rad) of k formulas that are fitted together."""

    places: tuple[Place, ...]
    observations: Array
    targets: Array


def written_places(vocabulary: Vocabulary, mirror: Sequence[int] | None) -> tuple[Place, ...]:
    """Lists the formulas of a policy that are not mirror images of earlier ones."""
    n_states = len(indices_of("machine state", vocabulary.names))
    every = [(state, joint) for state in range(n_states) for joint in range(quadruped.N_JOINTS)]
    if mirror is None:
        return tuple(every)
    image = FormulaMirror.of(vocabulary, mirror)
    return tuple(place for place in every if place < image.place(place))


def samples_by_state(
    samples: TrainingSet, vocabulary: Vocabulary, mirror: Sequence[int] | None
) -> list[FormulaSamples]:
    """Groups samples by the RM state whose formulas they fit; with a mirror, each counts twice."""
    # Add the mirror images.
    if mirror is not None:
        reflect = reflect_observation(samples.observation_names, mirror)
        samples = replace(
            samples,
            observations=np.concatenate([samples.observations, reflect(samples.observations)]),
            actions=np.concatenate([samples.actions, REFLECT_JOINTS(samples.actions)]),
            starts=np.tile(samples.starts, 2),
        )

    # Group by state, and select the targets of the written formulas.
    targets = samples.robot.joint_targets(samples.actions)
    written, groups = written_places(vocabulary, mirror), []
    for state, mask in enumerate(samples.by_state()):
        places = tuple(place for place in written if place[0] == state)
        if places:
            joints = [joint for _, joint in places]
            observations = samples.observations[mask]
            groups.append(FormulaSamples(places, observations, targets[mask][:, joints]))
    return groups


def formula_policy(
    samples: TrainingSet,
    vocabulary: Vocabulary,
    formulas: Mapping[Place, Expression],
    mirror: tuple[int, ...] | None = None,
) -> FormulaPolicy:
    """Returns the policy of the formulas and, with a mirror, of their mirror images."""
    if mirror is not None:
        formulas = FormulaMirror.of(vocabulary, mirror).complete(formulas)
    robot = samples.robot
    file = FormulaFile(samples.gait, vocabulary, formulas, mirror, robot=robot.name)
    # This leaves out definitions that no formula uses.
    return FormulaPolicy.from_file(file.with_formulas(formulas), robot)


def readings_of(gait: Gait, robot: Robot, names: tuple[str, ...], observations: Array) -> Readings:
    """Returns the ranges that quantities are clipped to: those of samples (m, n) and a margin."""
    box = measured_box(gait, robot, names, observations.min(axis=0), observations.max(axis=0))
    return Readings.around(names, box.lower, box.upper)


def settled(formula: Expression, names: Sequence[str], state: int) -> Expression:
    """Replaces the entries of the RM state in a formula by their values in a given state."""
    known = {index: float(i == state) for i, index in enumerate(indices_of("machine state", names))}
    return _settled(formula, known)


def _settled(formula: Expression, known: Mapping[int, float]) -> Expression:
    if formula.operator == "variable" and formula.variable in known:
        return constant(known[formula.variable])
    if known.keys().isdisjoint(formula.variables):
        return formula
    operands = tuple(_settled(operand, known) for operand in formula.operands)
    if formula.operator == "mul" and all(operand.operator == "constant" for operand in operands):
        return constant(operands[0].value * operands[1].value)
    return Expression(formula.operator, operands)


def readable(formulas: Sequence[Expression], values: Array, targets: Array) -> list[Expression]:
    """Rounds k formulas to `DIGITS` digits, and corrects their constants for the bias.

    `values` (m, n) are samples of all variables, and `targets` (m, k) those of the fit.
    """
    short = [rounded(formula) for formula in formulas]
    bias = (targets - Tape(short, values.shape[1])(values)).mean(axis=0)
    return [rounded(_raised(formula, float(b))) for formula, b in zip(short, bias, strict=True)]


def rounded(formula: Expression) -> Expression:
    """Rounds the numbers of a formula to `DIGITS` digits, in canonical form."""
    short = (float(f"{number:.{DIGITS}g}") for number in numbers_of(formula))
    return canonical(with_numbers(formula, short))


def short_numbers(policy: FormulaPolicy) -> FormulaPolicy:
    """Rounds the numbers of all formulas of a policy to `DIGITS` digits."""
    file = policy.to_file()
    formulas = {place: rounded(formula) for place, formula in file.formulas.items()}
    return FormulaPolicy.from_file(replace(file, formulas=formulas), policy.robot)


def _raised(formula: Expression, increment: float) -> Expression:
    """Adds a number to the leading constant of a sum, if there is one."""
    match formula:
        case Expression("constant", value=value):
            return constant(value + increment)
        case Expression(("add" | "sub") as operator, (left, right)):
            return Expression(operator, (_raised(left, increment), right))
        case _:
            return formula
