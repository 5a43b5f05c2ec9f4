"""Formula files of one robot, written anew for another.

Joints of the other robot move about its default stance as those of the first did about theirs:

    target' = target(q' + d, a' + d) - d,    d = stance - stance'

Angles, targets and their ranges are shifted by d (rad), gains are in the ratio of the robots' own,
and limits are those of the other robot. All other numbers stay: lengths, masses and times are not
scaled, so robots of about the same size are meant.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import (
    Expression,
    canonical,
    constant,
    plus,
    variable,
)
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.quantities import Definition
from glassgait.models.formulas.readings import Readings
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import entries_of
from glassgait.models.task.symmetry import REFLECT_JOINTS

DIGITS = 9
"""Decimals of a shift: a stance is written with fewer, and differences have no others."""

MEASURED, SENT = "joint position", "previous action"
"""Groups of observations that count from the default stance."""

LEFT = ("FL", "RL")
"""Legs whose hips the ranges of hips are of."""

_BY_THE, _LENGTHS = ", by the ", "'s lengths"
"""Before and after the name of the robot by whose lengths a definition places feet."""


def for_robot(file: FormulaFile, own: Robot, other: Robot) -> FormulaFile:
    """Writes a robot's file anew for another robot.

    Args:
        file: The file.
        own: The robot that it is of.
        other: The robot that is to act by it.

    Raises:
        InputError: if the other robot's default stance is beyond its limits.
    """
    shift = np.round(own.default_stance - other.default_stance, DIGITS)
    if not np.array_equal(REFLECT_JOINTS(shift), shift):
        # Images of what is shifted would not be what their joints are shifted to.
        file = replace(file, mirror=None)
    images = _shifted(file.vocabulary.names, shift)
    definitions = [
        replace(
            definition,
            formula=_replaced(definition.formula, images),
            note=_note(definition, own, other),
        )
        for definition in file.written_definitions()
    ]
    formulas = {
        place: _raised(_replaced(formula, images), -shift[place[-1]])
        for place, formula in file.written().items()
    }
    return replace(
        file.with_written(definitions, formulas),
        joint_law=file.joint_law.for_robot(own, other),
        robot=other.name,
        readings=None if file.readings is None else _read(file.readings, shift),
    )


def _note(definition: Definition, own: Robot, other: Robot) -> str:
    """Returns what a definition means: places of feet are those of the first robot's legs."""
    if not {"sin", "cos"} & {*_operators(definition.formula)}:
        return definition.note
    note, by, owner = definition.note.removesuffix(_LENGTHS).partition(_BY_THE)
    owner = owner if by else own.name
    return note if owner == other.name else f"{note}{_BY_THE}{owner}{_LENGTHS}"


def _operators(formula: Expression) -> Iterator[str]:
    yield formula.operator
    for operand in formula.operands:
        yield from _operators(operand)


def _shifted(names: tuple[str, ...], shift: Array) -> dict[int, Expression]:
    """Returns what stands for each observed quantity that counts from another stance."""
    images = {}
    for index, entry in enumerate(entries_of(names)):
        if entry.group in (MEASURED, SENT):
            by = shift[quadruped.joint_index(entry.symbol.split(".")[1])]
            if by:
                images[index] = _raised(variable(index), by)
    return images


def _replaced(formula: Expression, images: Mapping[int, Expression]) -> Expression:
    return canonical(_folded(formula.replaced(images))) if images else formula


def _folded(formula: Expression) -> Expression:
    """Joins two numbers that are added to a variable, one after the other."""
    operands = tuple(_folded(operand) for operand in formula.operands)
    match formula.operator, operands:
        case (
            ("add" | "sub") as operator,
            (
                Expression(
                    "add" | "sub", (Expression("variable") as own, Expression("constant"))
                ) as inner,
                Expression("constant") as last,
            ),
        ):
            joined = _with_constant(inner, last.value if operator == "add" else -last.value)
            assert joined is not None
            return joined if joined.operands[1].value else own
        case operator, _:
            return Expression(operator, operands) if operands else formula


def _raised(formula: Expression, by: float) -> Expression:
    """Adds a number to a formula: to its constant term, where it has one."""
    if not by:
        return formula
    found = _with_constant(formula, by)
    return canonical(plus(formula, constant(by)) if found is None else found)


def _with_constant(formula: Expression, by: float) -> Expression | None:
    match formula.operator, formula.operands:
        case "constant", _:
            return constant(round(formula.value + by, DIGITS))
        case ("add" | "sub") as operator, (left, right):
            found = _with_constant(left, by)
            if found is not None:
                return Expression(operator, (found, right))
            found = _with_constant(right, by if operator == "add" else -by)
            return None if found is None else Expression(operator, (left, found))
    return None


def _read(readings: Readings, shift: Array) -> Readings:
    """Returns the ranges of angles, as wide as all legs need that share one."""
    both = np.stack([shift, REFLECT_JOINTS(shift)])
    of_legs = both.reshape(2, quadruped.N_LEGS, len(quadruped.LEG_JOINTS))
    left = of_legs[:, [leg in LEFT for leg in quadruped.LEGS]].reshape(-1, of_legs.shape[-1])
    by = {f"q.{joint}": left[:, part] for part, joint in enumerate(quadruped.LEG_JOINTS)}

    def moved(kind: str, low: float, high: float) -> tuple[float, float]:
        shifts = by.get(kind, np.zeros(1))
        return round(low - float(shifts.max()), DIGITS), round(high - float(shifts.min()), DIGITS)

    return Readings(tuple((kind, moved(kind, *ends)) for kind, ends in readings.ranges))
