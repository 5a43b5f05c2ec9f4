"""Variables of formulas: observations in the robot's units, their ranges, and definitions.

A policy observes scaled numbers; a formula uses quantities: joint angles and targets in rad, speeds
in m/s, heights in m. Quantities may be clipped to ranges measured on robots, so that a stuck sensor
moves a target no further than readings within the range. Definitions are formulas of quantities,
such as the speed error or the position of a foot.
"""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Self

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression, variable
from glassgait.models.formulas.grammar import parse_formula
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import (
    Group,
    ObservationEntry,
    ObservationLayout,
    entries_of,
    symbols_of,
)

LIMITED: tuple[Group, ...] = (
    "commanded velocity",
    "joint position",
    "joint velocity",
    "angular velocity",
    "foot height",
)
"""Groups with a range by default: commands and readings of one sensor.

Gravity's direction and the velocity have none, since clipping them causes more falls on slopes and
after pushes.
"""

SENSED: tuple[Group, ...] = (*LIMITED, "gravity", "base velocity")
"""Groups that may have a range: all but targets, counts and the RM state."""

SENT = 0.2
"""Distance of a joint's previous target from its default stance where `sent` is tanh(1) (rad)."""


@dataclass(frozen=True)
class RobotUnits:
    """The affine map `observation = scale * (quantity - offset)`, with arrays (n)."""

    scale: Array
    offset: Array
    robot: Robot

    @classmethod
    def of(cls, robot: Robot, names: Sequence[str]) -> Self:
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
    # A formula may overflow; `Policy` turns actions that are not finite into NaN.
    with np.errstate(over="ignore", invalid="ignore"):
        return (target - robot.default_stance) / robot.action_scale


def _offset(robot: Robot, entry: ObservationEntry) -> float:
    """Returns the default stance of a joint position or target, which is observed from there."""
    if entry.group not in ("joint position", "previous action"):
        return 0.0
    joint = entry.symbol.split(".")[1]
    return float(robot.default_stance[quadruped.joint_index(joint)])


Range = tuple[float, float]


@dataclass(frozen=True)
class Readings:
    """Ranges that quantities are clipped to before formulas read them.

    To keep a policy's mirror symmetry, all legs share a range, and a quantity that changes its sign
    in the mirror has a symmetric range.

    Attributes:
        ranges: Least and greatest value of each kind, such as "q.hip"; mirrored for right hips.
    """

    ranges: tuple[tuple[str, Range], ...]

    def __post_init__(self) -> None:
        # Sort the ranges, so that the given order makes no difference.
        known = {kind: place for place, kind in enumerate(_KINDS)}
        ordered = sorted(self.ranges, key=lambda named: known.get(named[0], len(known)))
        ranges = tuple((kind, (float(low), float(high))) for kind, (low, high) in ordered)
        object.__setattr__(self, "ranges", ranges)
        # Refuse asymmetric ranges, by which the policy would favour a side.
        for kind, (low, high) in ranges:
            if not -math.inf < low < high < math.inf:
                raise InputError(
                    f"{kind} is read from {low:g} to {high:g}; give the least, then the greatest"
                )
            if kind in _SIGN_CHANGING and low != -high:
                most = max(-low, high)
                raise InputError(
                    f"{kind} is read from {low:g} to {high:g}, and in a mirror from {-high:g} to "
                    f"{-low:g}; give a symmetric range, such as from {-most:g} to {most:g}"
                )

    @classmethod
    def around(cls, names: Sequence[str], lower: Array, upper: Array) -> Self:
        """Returns the ranges of `LIMITED` groups that contain a box of quantities, rounded outward.

        The box is given by least and greatest quantities (n).
        """
        # Join the ranges of all legs, with those of right hips mirrored.
        hulls: dict[str, Range] = {}
        for entry, low, high in zip(entries_of(names), lower, upper, strict=True):
            if entry.group in LIMITED:
                kind = _kind_of(entry)
                ends = (-high, -low) if _is_mirrored(entry) else (low, high)
                if kind in _SIGN_CHANGING:
                    ends = min(ends[0], -ends[1]), max(-ends[0], ends[1])
                known = hulls.get(kind, ends)
                hulls[kind] = float(min(known[0], ends[0])), float(max(known[1], ends[1]))
        return cls(tuple((kind, _outward(*hull)) for kind, hull in hulls.items()))

    def ends(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Returns least and greatest quantities (n), which are infinite without a range."""
        known, ends = dict(self.ranges), []
        for entry in entries_of(names):
            low, high = known.get(_kind_of(entry), (-math.inf, math.inf))
            ends.append((-high, -low) if _is_mirrored(entry) else (low, high))
        least, greatest = np.array(ends).T
        return least, greatest

    def refuse_others(self, names: Sequence[str]) -> None:
        known = {_kind_of(entry) for entry in entries_of(names)}
        if other := [kind for kind, _ in self.ranges if kind not in known]:
            imu = ", or add 'senses: imu' to the header" if other[0] in _KINDS else ""
            raise InputError(f"unknown sensed quantity {other[0]!r}; leave it out{imu}")


def _kind_of(entry: ObservationEntry) -> str:
    """Returns the kind of an observation, such as "q.hip"; empty if it can have no range."""
    if entry.group not in SENSED:
        return ""
    if entry.leg is None:
        return entry.symbol
    return re.sub(rf"\.{entry.leg}_?", ".", entry.symbol).rstrip(".")


def _is_mirrored(entry: ObservationEntry) -> bool:
    """Returns whether an observation is of a right leg and changes its sign in the mirror."""
    return entry.mirror_sign < 0.0 and entry.leg is not None and entry.leg.endswith("R")


_ENTRIES = ObservationLayout(1, imu=True).entries
_KINDS = tuple(dict.fromkeys(kind for entry in _ENTRIES if (kind := _kind_of(entry))))
"""All kinds, in the order of observations."""

_SIGN_CHANGING = frozenset(
    entry.symbol for entry in _ENTRIES if entry.leg is None and entry.mirror_sign < 0.0
)
"""Kinds of the trunk that change their sign in the mirror, such as "g.y"."""


def _outward(low: float, high: float) -> Range:
    # Keep two digits after the first digit of the range's width.
    step = 10.0 ** (math.floor(math.log10(max(high - low, 1e-6))) - 2)
    # Allow for rounding errors of an end that already has so many digits.
    first, last = math.floor(low / step + 1e-6), math.ceil(high / step - 1e-6)
    # Formatting removes the digits that the product adds.
    return float(f"{first * step:.12g}"), float(f"{last * step:.12g}")


@dataclass(frozen=True)
class Definition:
    """A named formula of observed quantities, in canonical form, and a note on its meaning."""

    symbol: str
    formula: Expression
    note: str = ""


@dataclass(frozen=True)
class Vocabulary:
    """The variables of formulas: the observed quantities (n), then the definitions."""

    names: tuple[str, ...]
    definitions: tuple[Definition, ...] = ()

    @cached_property
    def symbols(self) -> tuple[str, ...]:
        return (*symbols_of(self.names), *(definition.symbol for definition in self.definitions))

    @cached_property
    def _defined(self) -> dict[int, Expression]:
        first = len(self.names)
        return {first + i: definition.formula for i, definition in enumerate(self.definitions)}

    def variable(self, symbol: str) -> Expression:
        return variable(self.symbols.index(symbol))

    def expanded(self, formula: Expression) -> Expression:
        """Replaces definitions by their formulas of observed quantities."""
        return formula.replaced(self._defined)

    def using(self, formulas: Iterable[Expression]) -> tuple["Vocabulary", list[Expression]]:
        """Returns the vocabulary with the definitions used, and the formulas in its variables."""
        formulas, n = list(formulas), len(self.names)
        variables = frozenset().union(*(formula.variables for formula in formulas))
        used = sorted(index for index in variables if index >= n)
        # Number the used definitions after the observed quantities.
        images = {index: variable(n + place) for place, index in enumerate(used)}
        definitions = tuple(self.definitions[index - n] for index in used)
        return Vocabulary(self.names, definitions), [f.replaced(images) for f in formulas]


@cache
def known_definitions(robot: Robot, names: tuple[str, ...]) -> tuple[Definition, ...]:
    """Returns the definitions that fits may use, for observations of the given names."""
    symbols = symbols_of(names)
    imu = _OF_THE_IMU if "w.z" in symbols else ()
    legs = (statement for leg in quadruped.LEGS for statement in _of_leg(robot, leg))
    return tuple(
        Definition(symbol, parse_formula(text, symbols), note)
        for symbol, text, note in (*_OF_THE_TRUNK, *imu, *legs)
    )


_OF_THE_TRUNK = (
    ("late", "tanh(0.5*t - 2)", "-1 as a state begins, 0 after 4 control steps, 1 late in it"),
    ("phase", "t/cmd.t", "share of the commanded time in the state that is over"),
    ("wave", "sin(3.14*t/cmd.t)", "0 as a state begins, 1 in its middle, 0 when it should end"),
    ("wait", "0.5 + 0.5*tanh(4*(t - cmd.t) - 6)", "1 two control steps late or more, otherwise 0"),
    ("e.v", "cmd.v - v.x", "m/s, by how much the robot is slower than it should be"),
)

_OF_THE_IMU = (
    ("e.yaw", "cmd.yaw - w.z", "rad/s, by how much the robot turns too little to the left"),
)


def _of_leg(robot: Robot, leg: str) -> Iterator[tuple[str, str, str]]:
    lifted = f"tanh(100*h.{leg} - 2)"
    yield f"lifted.{leg}", lifted, "-1 on the ground, 0 at 2 cm, 1 in the air"
    # For hips, `sent` distinguishes in and out, so that mirrored legs have the same meaning.
    for part in quadruped.LEG_JOINTS:
        joint, is_hip = f"{leg}_{part}", part == "hip"
        side = float(robot.side[quadruped.LEGS.index(leg)]) if is_hip else 1.0
        slope, stance = side / SENT, float(robot.default_stance[quadruped.joint_index(joint)])
        below, above = ("inward", "outward") if is_hip else ("below its stance", "above it")
        sent = f"tanh({slope!r}*a.{joint} - {slope * stance!r})"
        yield f"sent.{joint}", sent, f"-1 where last sent {below}, 1 {above}"
    # Locate the foot in the plane of the leg, by the angles of thigh and shank to the vertical.
    thigh, shank = f"q.{leg}_thigh", f"(q.{leg}_thigh + q.{leg}_calf)"
    for axis, wave, note in (
        ("x", "sin", "m, how far the foot is before its hip"),
        ("z", "cos", "m, how high the foot is over its hip"),
    ):
        upper = f"{-robot.thigh_length!r}*{wave}({thigh})"
        yield f"{axis}.{leg}", f"{upper} - {robot.calf_length!r}*{wave}{shank}", note


GATES = ("late", *(f"lifted.{leg}" for leg in quadruped.LEGS))
"""Definitions of the phase of the gait, all of them bounded.

A product with the time itself would grow without bound while a robot stays in a state.
"""

PHASES = ("phase", "wave", "wait")  # definitions of the time in an RM state
