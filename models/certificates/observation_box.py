"""Boxes of observations: what a robot may sense, each quantity between a least and a greatest."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.imu import IMU_NOISE
from glassgait.models.files import read_yaml, write_atomically
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import robot_folder, robot_of
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.task.gait import Gait, gait_names, shipped_gait
from glassgait.models.task.observation import (
    JOINT_POSITION_NOISE,
    OVERDUE,
    ObservationEntry,
    ObservationLayout,
    entries_of,
    indices_of,
    machine_state_entries,
    symbols_of,
)
from glassgait.models.task.termination import TerminationLimits

BOX_DIRECTORY = Path(__file__).parent / "boxes"

FASTEST_TURN = 20.0
"""Greatest angular velocity that the gyroscope gives, about any axis (rad/s), stated."""

GRAVITY_SYMBOL = "g.x"
"""What robots observe that have an IMU."""

ATTITUDE_NOISE = float(IMU_NOISE[-1])
"""Half-width of the noise on each coordinate of gravity's direction."""

FASTEST_JOINT = 50.0
"""Greatest joint velocity that the encoders measure (rad/s), stated; the motors reach 21."""

FASTEST_TRUNK = 3.0
"""Greatest trunk velocity that the estimator gives, along any axis (m/s), stated."""

FOOT_HEIGHTS = (-0.1, 0.4)
"""Least and greatest foot height that the estimator gives (m), stated: a leg is 0.4 m long."""

MARGIN = 0.1
"""Share of its width that a measured range is widened by, on both sides."""

DECIMALS = 4
"""Decimals of a box's numbers in the robot's units; measured ends are rounded outward to them."""

COUNTED = ("iterations", "commanded iterations")
"""Groups whose quantities are whole numbers."""


@dataclass(frozen=True)
class ObservationBox:
    """All observations between two corners, in the observation's own scaled units.

    Attributes:
        robot: The robot.
        names: Names of the observations (n), in order.
        lower: Least value of each (n).
        upper: Greatest value of each (n).
    """

    robot: Robot
    names: tuple[str, ...]
    lower: Array
    upper: Array

    def __post_init__(self) -> None:
        """
        Raises:
            InputError: if a name is unknown, or a range is empty or not finite.
        """
        entries_of(self.names)
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not -math.inf < low <= high < math.inf:
                raise InputError(
                    f"the box of {shown(name)} goes from {low:g} to {high:g}; give the least, then "
                    "the greatest"
                )

    @classmethod
    def of_quantities(
        cls, robot: Robot, names: tuple[str, ...], ranges: Mapping[str, tuple[float, float]]
    ) -> Self:
        """Builds a box from ranges in the robot's units, by symbol such as "q.FL_hip".

        Raises:
            InputError: if a name is unknown, or a range is missing, empty or not finite.
        """
        symbols = symbols_of(names)
        for symbol in symbols:
            if symbol not in ranges:
                raise InputError(f"the box lacks {symbol!r}; give its least and greatest value")
        corners = np.array([ranges[symbol] for symbol in symbols], dtype=float).T
        lower, upper = RobotUnits.of(robot, names).observed(corners)
        return cls(robot, names, lower, upper)

    @property
    def quantities(self) -> tuple[Array, Array]:
        """The corners in the robot's units, rounded to `DECIMALS` as files hold them (n, n)."""
        units = RobotUnits.of(self.robot, self.names)
        low, high = units.quantities(self.lower), units.quantities(self.upper)
        return _rounded(low), _rounded(high)

    def clipped(self, observation: Array) -> Array:
        """Returns the observations (..., n) of the box that are nearest to the given ones."""
        return np.clip(observation, self.lower, self.upper)

    def widened(self, share: float) -> Self:
        """Returns the box with each range widened on both sides by a share of its width."""
        margin = share * (self.upper - self.lower)
        return replace(self, lower=self.lower - margin, upper=self.upper + margin)

    def hull(self, other: Self) -> Self:
        """Returns the least box that holds this one and another."""
        lower, upper = np.minimum(self.lower, other.lower), np.maximum(self.upper, other.upper)
        return replace(self, lower=lower, upper=upper)

    def taking(self, names: Collection[str], other: Self) -> Self:
        """Returns this box with the ranges that another gives the named observations."""
        taken = np.isin(self.names, list(names))
        lower = np.where(taken, other.lower, self.lower)
        return replace(self, lower=lower, upper=np.where(taken, other.upper, self.upper))

    def in_state(self, state: int) -> Self:
        """Returns the box with the one-hot machine state held."""
        one_hot = machine_state_entries(self.names)
        held = np.zeros(len(self.names), dtype=bool)
        held[one_hot] = True
        value = np.zeros(len(self.names))
        value[one_hot.start + state] = 1.0
        lower = np.where(held, value, self.lower)
        return replace(self, lower=lower, upper=np.where(held, value, self.upper))

    @property
    def n_states(self) -> int:
        """Number of the machine's states."""
        return len(indices_of("machine state", self.names))

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Draws observations (count, n) of the box: counts whole, and the machine in one state."""
        units = RobotUnits.of(self.robot, self.names)
        observations = generator.uniform(self.lower, self.upper, (count, len(self.names)))
        for index, entry in enumerate(entries_of(self.names)):
            if entry.group in COUNTED:
                low, high = _whole(self, index, units)
                counts = generator.integers(low, high + 1, count)
                observations[:, index] = (counts - units.offset[index]) * units.scale[index]
        one_hot = machine_state_entries(self.names)
        allowed = np.flatnonzero(self.upper[one_hot] == 1.0)
        observations[:, one_hot] = np.eye(self.n_states)[generator.choice(allowed, count)]
        return self.clipped(observations)

    def lines(self) -> list[str]:
        """Writes the box in the robot's units, a line a quantity."""
        ends = zip(entries_of(self.names), *self.quantities, strict=True)
        return [
            f"{entry.symbol}: {low:g} to {high:g} {entry.unit}".rstrip()
            for entry, low, high in ends
        ]

    def save(self, path: Path, gait: Gait, measured: str) -> None:
        """Writes the box to a YAML file in the robot's units, atomically.

        Args:
            path: The file.
            gait: Whose robots it is of.
            measured: How the box came about, in words.
        """
        ends = zip(entries_of(self.names), *self.quantities, strict=True)
        ranges = {entry.symbol: [float(low), float(high)] for entry, low, high in ends}
        robot = {} if self.robot.name == DEFAULT_ROBOT else {"robot": self.robot.name}
        whole = {"gait": gait.name, **robot, "measured": measured, "ranges": ranges}
        text = yaml.safe_dump(whole, sort_keys=False, default_flow_style=None, width=100)
        write_atomically(path, text)


def load_box(path: Path, gait: Gait, robot: Robot) -> ObservationBox:
    """Loads a box of what a gait's robots observe from its file.

    Raises:
        InputError: if the file cannot be read, is of another gait or robot, lacks a range, or holds
            another thing in its place; the message names file and key.
    """
    found = read_yaml(path)
    ranges = found.get("ranges") if isinstance(found, dict) else None
    if not isinstance(ranges, dict):
        raise InputError(f"{path}: lacks the key 'ranges'; measure the box anew")
    if (theirs := found.get("gait")) != gait.name:
        raise InputError(
            f"{path}: key 'gait' is {shown(theirs)}; give a box of the {gait.name}, or add "
            "--measure to 'glassgait verify prove'"
        )
    robot_of(path, found.get("robot"), robot)
    # Which ranges there are says whether robots observed an IMU.
    names = ObservationLayout(gait.n_states, imu=GRAVITY_SYMBOL in ranges).names
    for symbol, ends in ranges.items():
        if not _is_range(ends):
            raise InputError(
                f"{path}: key {shown(symbol)} is {shown(ends)}; it must be [least, greatest]"
            )
    known = set(symbols_of(names))
    if unknown := [symbol for symbol in ranges if symbol not in known]:
        raise InputError(f"{path}: no quantity is called {shown(unknown[0])}; remove it")
    try:
        return ObservationBox.of_quantities(robot, names, ranges)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def operating_box(gait: Gait, robot: Robot, path: Path | None = None) -> ObservationBox:
    """Loads the box that robots of a gait were measured in.

    Args:
        gait: The gait.
        robot: The robot.
        path: The box's file; the shipped one by default.

    Raises:
        InputError: if there is none, or it is of another machine, or its file is not one.
    """
    if path is None and gait.name in gait_names():
        key = shipped_gait(gait.name).first_difference(gait)
        if key is not None:
            raise InputError(
                f"the operating box that ships is of another machine than this {gait.name}, which "
                f"differs in {key!r}; add --measure to measure its own, or name one with --box"
            )
    path = path or robot_folder(BOX_DIRECTORY, robot.name) / f"{gait.name}.yaml"
    if not path.exists():
        raise InputError(
            f"{path}: there is no operating box of the {gait.name}; add --measure to "
            "'glassgait verify prove', or give its file by --box"
        )
    return load_box(path, gait, robot)


def physical_box(gait: Gait, operating: ObservationBox) -> ObservationBox:
    """Returns the box of what the robot can be and its sensors can measure.

    Joint angles reach as far as a robot that is not failed, and the noise of encoders, let them;
    targets of the step before reach the joints' limits. Where the operating box goes further, as
    policies do that ask for more than a joint can reach, so does this one. Commands are the gait's.
    """
    return _limits(gait, operating).hull(operating)


def measured_box(
    gait: Gait, robot: Robot, names: tuple[str, ...], lower: Array, upper: Array
) -> ObservationBox:
    """Returns the box of what robots observed, its ranges widened by `MARGIN`.

    Commands, counts and machine state are at their true ranges.

    Args:
        gait: The gait.
        robot: The robot.
        names: Names of the observations (n).
        lower: Least values that were observed (n).
        upper: Greatest ones (n).
    """
    box = ObservationBox(robot, names, lower, upper).widened(MARGIN)
    return rounded_outward(commanded(box, gait))


def commanded(box: ObservationBox, gait: Gait) -> ObservationBox:
    """Returns a box with commands, counts and machine state at their true ranges."""
    groups = ("commanded velocity", "machine state", *COUNTED)
    taken = [entry.name for entry in entries_of(box.names) if entry.group in groups]
    return box.taking(taken, _limits(gait, box))


def _limits(gait: Gait, box: ObservationBox) -> ObservationBox:
    """Returns the box of what a box's quantities can be, whatever its own ranges are."""
    entries = entries_of(box.names)
    ranges = {entry.symbol: _physical_range(entry, gait, box.robot) for entry in entries}
    return ObservationBox.of_quantities(box.robot, box.names, ranges)


def _physical_range(entry: ObservationEntry, gait: Gait, robot: Robot) -> tuple[float, float]:
    reach = TerminationLimits().joint_overrun + JOINT_POSITION_NOISE
    match entry.group:
        case "commanded velocity":
            most = gait.max_speed if entry.symbol == "cmd.v" else gait.max_yaw_rate
            return -most, most
        case "joint position":
            low, high = _joint_range(entry, robot)
            return _outward(low - reach, high + reach)
        case "previous action":
            return _outward(*_joint_range(entry, robot))
        case "gravity":
            return -1.0 - ATTITUDE_NOISE, 1.0 + ATTITUDE_NOISE
        case "angular velocity":
            return -FASTEST_TURN, FASTEST_TURN
        case "joint velocity":
            return -FASTEST_JOINT, FASTEST_JOINT
        case "machine state":
            return 0.0, 1.0
        case "iterations":
            return 0.0, float(gait.dwell[1] + OVERDUE)
        case "commanded iterations":
            return float(gait.dwell[0]), float(gait.dwell[1])
        case "base velocity":
            return -FASTEST_TRUNK, FASTEST_TRUNK
        case "foot height":
            return FOOT_HEIGHTS


def _joint_range(entry: ObservationEntry, robot: Robot) -> tuple[float, float]:
    joint = quadruped.joint_index(entry.symbol.partition(".")[2])
    return float(robot.lower_limits[joint]), float(robot.upper_limits[joint])


def _outward(low: float, high: float) -> tuple[float, float]:
    # What is off the last decimal by rounding alone is on it.
    factor = 10.0**DECIMALS
    return math.floor(round(low * factor, 6)) / factor, math.ceil(round(high * factor, 6)) / factor


def rounded_outward(box: ObservationBox) -> ObservationBox:
    """Returns the least box around one whose ends, in the robot's units, have `DECIMALS`."""
    units, factor = RobotUnits.of(box.robot, box.names), 10.0**DECIMALS
    low = np.floor(units.quantities(box.lower) * factor) / factor
    high = np.ceil(units.quantities(box.upper) * factor) / factor
    ends = zip(symbols_of(box.names), low.tolist(), high.tolist(), strict=True)
    return ObservationBox.of_quantities(box.robot, box.names, {name: (a, b) for name, a, b in ends})


def _rounded(quantities: Array) -> Array:
    return np.round(quantities, DECIMALS) + 0.0


def _whole(box: ObservationBox, index: int, units: RobotUnits) -> tuple[int, int]:
    low, high = (units.quantities(corner)[index] for corner in (box.lower, box.upper))
    return math.ceil(low - 1e-9), math.floor(high + 1e-9)


def _is_range(ends: Any) -> bool:
    return (
        isinstance(ends, list)
        and len(ends) == 2
        and all(isinstance(end, int | float) and not isinstance(end, bool) for end in ends)
    )
