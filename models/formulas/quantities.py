"""What formulas are written in: the observations in the robot's units, and what follows from them.

A policy observes scaled numbers. A formula speaks of quantities: joint angles and targets in rad,
speeds in m/s, heights in m. Defined quantities are formulas of these, such as the error of the
speed or where a foot is.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Self

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.formulas.expression import Expression, canonical, constant, variable
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import ObservationEntry, entries_of, symbols_of

LATE = 4.0
"""Control steps in a state of the machine that are neither early nor late."""

LIFTED = 0.02
"""Height of a foot that is neither on the ground nor in the air (m)."""

SENT = 0.2
"""How far from its default stance a joint's last target is clearly to one side (rad)."""


@dataclass(frozen=True)
class RobotUnits:
    """The affine map between observations and quantities.

    Attributes:
        scale: What a quantity, less its offset, is multiplied by to be observed (n).
        offset: The quantity where the observation is 0 (n).
        robot: The robot.
    """

    scale: Array
    offset: Array
    robot: Robot

    @classmethod
    def of(cls, robot: Robot, names: Sequence[str]) -> Self:
        """Returns the map of a robot's observations of the given names.

        Raises:
            InputError: if a name is unknown.
        """
        entries = entries_of(names)
        scale = np.array([entry.scale(robot) for entry in entries])
        return cls(scale, np.array([_offset(robot, entry) for entry in entries]), robot)

    def quantities(self, observation: Array) -> Array:
        """Maps observations (..., n) to quantities (..., n)."""
        return observation / self.scale + self.offset

    def observed(self, quantities: Array) -> Array:
        """Maps quantities (..., n) to observations (..., n)."""
        return (quantities - self.offset) * self.scale


def actions_of(robot: Robot, target: Array) -> Array:
    """Maps joint targets (..., 12; rad) to actions (..., 12)."""
    # A formula may say anything; what is not finite is refused where it would act.
    with np.errstate(over="ignore", invalid="ignore"):
        return (target - robot.default_stance) / robot.action_scale


def _offset(robot: Robot, entry: ObservationEntry) -> float:
    """Positions and targets are observed from the default stance; formulas hold the angles."""
    if entry.group not in ("joint position", "previous action"):
        return 0.0
    joint = entry.symbol.split(".")[1]
    return float(robot.default_stance[quadruped.joint_index(joint)])


@dataclass(frozen=True)
class Definition:
    """A formula of the observed quantities that has a name.

    Attributes:
        symbol: Its name in formulas, such as "e.v".
        formula: What it is, of the observed quantities, in canonical form.
        note: What it means, in words, with its unit if it has one.
    """

    symbol: str
    formula: Expression
    note: str = ""


@dataclass(frozen=True)
class Vocabulary:
    """What the variables of formulas are: the observed quantities, then those that are defined.

    Attributes:
        names: Names of the observations (n).
        definitions: The defined quantities.
    """

    names: tuple[str, ...]
    definitions: tuple[Definition, ...] = ()

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        """Names of all variables, in order.

        Raises:
            InputError: if an observation's name is unknown.
        """
        return (*symbols_of(self.names), *(definition.symbol for definition in self.definitions))

    @cached_property
    def _defined(self) -> dict[int, Expression]:
        first = len(self.names)
        return {first + i: definition.formula for i, definition in enumerate(self.definitions)}

    def variable(self, symbol: str) -> Expression:
        """Returns the variable of a name that there is."""
        return variable(self.symbols.index(symbol))

    def expanded(self, formula: Expression) -> Expression:
        """Puts in what defined quantities are; the observed ones are left."""
        return formula.replaced(self._defined)

    def using(self, formulas: Iterable[Expression]) -> tuple["Vocabulary", list[Expression]]:
        """Leaves out the definitions that no formula uses.

        Returns:
            The vocabulary, and the formulas with its variables.
        """
        kept, n = list(formulas), len(self.names)
        used = sorted(
            index for index in frozenset().union(*(f.variables for f in kept)) if index >= n
        )
        places = {index: variable(n + place) for place, index in enumerate(used)}
        definitions = tuple(self.definitions[index - n] for index in used)
        return Vocabulary(self.names, definitions), [formula.replaced(places) for formula in kept]


@cache
def known_definitions(robot: Robot, names: tuple[str, ...]) -> tuple[Definition, ...]:
    """Returns the defined quantities that fits may use, of observations of the given names.

    Raises:
        InputError: if a name is unknown.
    """
    of = {entry.symbol: variable(index) for index, entry in enumerate(entries_of(names))}
    return (
        Definition(
            "late",
            _turning(of["t"], slope=0.5, shift=0.5 * LATE),
            f"-1 as a state begins, 0 after {LATE:g} control steps, 1 late in it",
        ),
        Definition(
            "phase",
            Expression("div", (of["t"], of["cmd.t"])),
            "share of the commanded time in the state that is over",
        ),
        Definition(
            "e.v",
            Expression("sub", (of["cmd.v"], of["v.x"])),
            "m/s, by how much the robot is slower than it should be",
        ),
        *(definition for leg in quadruped.LEGS for definition in _of_leg(robot, leg, of)),
    )


GATES = ("late", *(f"lifted.{leg}" for leg in quadruped.LEGS))
"""Definitions of where in the gait the robot is.

All are bounded. A product with the time itself would grow without bound where the robot is late.
"""

COURSE = ("cmd.v", "v.y", "g.x", "w.y")
"""How fast the robot is to go, how it drifts sideways, how the ground falls ahead, how it pitches.

On real ground, and commanded to go forward as well as back, they change how all else counts.
"""

SENT_JOINTS = tuple(f"sent.{joint}" for joint in quadruped.JOINTS)
"""To which side of its default stance each joint was last sent.

A network has no memory but its last targets, and those that learned on real ground answer to them
as to switches.
"""


def _of_leg(robot: Robot, leg: str, of: dict[str, Expression]) -> list[Definition]:
    forward, up = _foot_in_plane(robot, of[f"q.{leg}_thigh"], of[f"q.{leg}_calf"])
    return [
        Definition(
            f"lifted.{leg}",
            _turning(of[f"h.{leg}"], slope=100.0, shift=100.0 * LIFTED),
            f"-1 on the ground, 0 at {100.0 * LIFTED:g} cm, 1 in the air",
        ),
        *(_sent(robot, leg, part, of) for part in quadruped.LEG_JOINTS),
        Definition(f"x.{leg}", forward, "m, how far the foot is before its hip"),
        Definition(f"z.{leg}", up, "m, how high the foot is over its hip"),
    ]


def _sent(robot: Robot, leg: str, part: str, of: dict[str, Expression]) -> Definition:
    """A hip's sides are out and in, so that a leg and its mirror image share what they mean."""
    joint = f"{leg}_{part}"
    slope = (float(robot.side[quadruped.LEGS.index(leg)]) if part == "hip" else 1.0) / SENT
    stance = float(robot.default_stance[quadruped.joint_index(joint)])
    below, above = ("inward", "outward") if part == "hip" else ("below its stance", "above it")
    return Definition(
        f"sent.{joint}",
        _turning(of[f"a.{joint}"], slope=slope, shift=slope * stance),
        f"-1 where last sent {below}, 1 {above}",
    )


def _turning(quantity: Expression, *, slope: float, shift: float) -> Expression:
    """Returns a function that goes from -1 below to 1 above shift ÷ slope."""
    inner = Expression("mul", (constant(slope), quantity))
    return canonical(Expression("tanh", (Expression("sub", (inner, constant(shift))),)))


def _foot_in_plane(
    robot: Robot, thigh: Expression, calf: Expression
) -> tuple[Expression, Expression]:
    """Returns where a foot is from its hip, forward and up in the plane of the leg."""
    shank = Expression("add", (thigh, calf))

    def sum_of(function: str) -> Expression:
        upper = Expression("mul", (constant(-robot.thigh_length), Expression(function, (thigh,))))
        lower = Expression("mul", (constant(robot.calf_length), Expression(function, (shank,))))
        return Expression("sub", (upper, lower))

    return sum_of("sin"), sum_of("cos")
