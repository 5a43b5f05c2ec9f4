"""Boxes of observations: a range for each quantity that a robot may sense."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import yaml

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.estimation.sensors import IMU_NOISE
from glassgait.models.files import read_yaml, write_atomically
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import robot_folder, robot_of
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.settings import Range, Settings, checked
from glassgait.models.task.gait import Gait, gait_names, shipped_gait
from glassgait.models.task.observation import (
    JOINT_POSITION_NOISE,
    OVERDUE,
    ObservationEntry,
    ObservationLayout,
    entries_of,
    machine_state_entries,
    symbols_of,
)
from glassgait.models.task.termination import TerminationLimits

BOX_DIRECTORY = Path(__file__).parent / "boxes"

FASTEST_TURN, FASTEST_JOINT, FASTEST_TRUNK, FOOT_HEIGHTS = 20.0, 50.0, 3.0, (-0.1, 0.4)
"""Assumed limits of the gyroscope and the encoders (rad/s), and of the estimator (m/s; m)."""

MARGIN = 0.1  # share of its width by which a measured range is widened on each side
DECIMALS = 4  # decimals of a box's numbers; measured and physical ends are rounded outward to them
COUNTED = ("iterations", "commanded iterations")  # groups whose quantities are whole numbers


@dataclass(frozen=True)
class ObservationBox:
    """All observations (n) between two corners (n), in the robot's units."""

    robot: Robot
    names: tuple[str, ...]
    lower: Array
    upper: Array

    @classmethod
    def of_ranges(
        cls, robot: Robot, names: tuple[str, ...], ranges: Mapping[str, Sequence[float]]
    ) -> Self:
        """Builds a box from ranges by symbol, such as "q.FL_hip"."""
        symbols = symbols_of(names)
        if missing := [symbol for symbol in symbols if symbol not in ranges]:
            raise InputError(f"the box lacks {missing[0]!r}; give its least and greatest value")
        if unknown := sorted({*ranges} - {*symbols}):
            raise InputError(f"no quantity is called {shown(unknown[0])}; remove it")
        lower, upper = np.array([ranges[symbol] for symbol in symbols], dtype=float).T
        return cls(robot, names, lower, upper)

    @property
    def ranges(self) -> dict[str, list[float]]:
        """The least and the greatest value of each quantity, by symbol."""
        ends = np.stack([self.lower, self.upper], axis=-1).tolist()
        return dict(zip(symbols_of(self.names), ends, strict=True))

    @property
    def counted(self) -> frozenset[int]:
        """The quantities that are whole numbers, by index."""
        entries = enumerate(entries_of(self.names))
        return frozenset(index for index, entry in entries if entry.group in COUNTED)

    def updated(self, indices: Collection[int], other: Self) -> Self:
        """Returns this box with the ranges at `indices` replaced by those of another box."""
        lower, upper, index = self.lower.copy(), self.upper.copy(), list(indices)
        lower[index], upper[index] = other.lower[index], other.upper[index]
        return replace(self, lower=lower, upper=upper)

    def in_state(self, state: int) -> Self:
        """Returns the box with the one-hot machine state fixed."""
        lower, upper = self.lower.copy(), self.upper.copy()
        one_hot = machine_state_entries(self.names)
        lower[one_hot] = upper[one_hot] = np.eye(one_hot.stop - one_hot.start)[state]
        return replace(self, lower=lower, upper=upper)

    def random(self, count: int, generator: np.random.Generator) -> Array:
        """Draws quantities (count, n), with whole counts and the machine in one state."""
        quantities = generator.uniform(self.lower, self.upper, (count, len(self.names)))
        for index in sorted(self.counted):
            low, high = math.ceil(self.lower[index]), math.floor(self.upper[index])
            quantities[:, index] = generator.integers(low, high + 1, count)
        one_hot = machine_state_entries(self.names)
        allowed = np.flatnonzero(self.upper[one_hot] == 1.0)
        states = np.eye(one_hot.stop - one_hot.start)
        quantities[:, one_hot] = states[generator.choice(allowed, count)]
        return quantities

    def save(self, path: Path, gait: Gait, measured: str) -> None:
        """Writes the box of a gait to a YAML file; `measured` says how it was measured."""
        robot = {} if self.robot.name == DEFAULT_ROBOT else {"robot": self.robot.name}
        content = {"gait": gait.name, **robot, "measured": measured, "ranges": self.ranges}
        text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=100)
        write_atomically(path, text)


@checked
class _BoxFile(Settings):
    title: ClassVar[str] = "box"

    gait: str
    ranges: dict[str, Range]
    robot: str | None = None
    measured: str = ""


def load_box(path: Path, gait: Gait, robot: Robot) -> ObservationBox:
    """Loads a box of a gait and a robot from its file."""
    file = _BoxFile.from_plain(read_yaml(path), str(path))
    if file.gait != gait.name:
        raise InputError(
            f"{path}: key 'gait' is {shown(file.gait)}; give a box of the {gait.name}, or add "
            "--measure to 'glassgait verify prove'"
        )
    robot_of(path, file.robot, robot)
    # Only an IMU observes the direction of gravity.
    names = ObservationLayout(gait.n_states, imu="g.x" in file.ranges).names
    try:
        return ObservationBox.of_ranges(robot, names, file.ranges)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def operating_box(gait: Gait, robot: Robot) -> ObservationBox:
    """Loads a gait's shipped box of the quantities that robots met in the scenarios."""
    if gait.name in gait_names():
        key = shipped_gait(gait.name).first_difference(gait)
        if key is not None:
            raise InputError(
                f"the shipped operating box is of another {gait.name}, which differs in {key!r}; "
                "add --measure to measure a box, or give one by --box"
            )
    path = robot_folder(BOX_DIRECTORY, robot.name) / f"{gait.name}.yaml"
    if not path.exists():
        raise InputError(
            f"{path}: there is no operating box of the {gait.name}; add --measure to "
            "'glassgait verify prove', or give its file by --box"
        )
    return load_box(path, gait, robot)


def physical_box(gait: Gait, operating: ObservationBox) -> ObservationBox:
    """Returns the box of all that the robot and its sensors can reach.

    Joint angles may exceed their limits by the overrun that the fall rule tolerates, and by the
    encoders' noise. The box contains the operating box.
    """
    limits = _limits(gait, operating)
    lower = np.minimum(limits.lower, operating.lower)
    return replace(operating, lower=lower, upper=np.maximum(limits.upper, operating.upper))


def measured_box(
    gait: Gait, robot: Robot, names: tuple[str, ...], lower: Array, upper: Array
) -> ObservationBox:
    """Returns the box of observations between two corners (n, n; scaled), widened by `MARGIN`.

    Commands, counts and machine state have their true ranges.
    """
    units, margin = RobotUnits.of(robot, names), MARGIN * (upper - lower)
    low, high = units.quantities(lower - margin), units.quantities(upper + margin)
    factor = 10.0**DECIMALS
    low, high = np.floor(low * factor) / factor + 0.0, np.ceil(high * factor) / factor + 0.0
    box = ObservationBox(robot, names, low, high)
    groups = ("commanded velocity", "machine state", *COUNTED)
    known = [index for index, entry in enumerate(entries_of(names)) if entry.group in groups]
    return box.updated(known, _limits(gait, box))


def _limits(gait: Gait, box: ObservationBox) -> ObservationBox:
    """Returns the physical ranges of a box's quantities."""
    entries = entries_of(box.names)
    ranges = {entry.symbol: _physical_range(entry, gait, box.robot) for entry in entries}
    return ObservationBox.of_ranges(box.robot, box.names, ranges)


def _physical_range(entry: ObservationEntry, gait: Gait, robot: Robot) -> tuple[float, float]:
    if entry.group in ("joint position", "previous action"):
        reach = TerminationLimits().joint_overrun + JOINT_POSITION_NOISE
        reach = reach if entry.group == "joint position" else 0.0
        joint = quadruped.joint_index(entry.symbol.partition(".")[2])
        low, high = robot.lower_limits[joint] - reach, robot.upper_limits[joint] + reach
        # Round outward, but not because of a rounding error in the last decimal.
        low, high = np.round(np.array([low, high]) * 10.0**DECIMALS, 6)
        return math.floor(low) / 10.0**DECIMALS, math.ceil(high) / 10.0**DECIMALS
    speed = gait.max_speed if entry.symbol == "cmd.v" else gait.max_yaw_rate
    steepest = 1.0 + float(IMU_NOISE[-1])
    ranges: dict[str, tuple[float, float]] = {
        "commanded velocity": (-speed, speed),
        "gravity": (-steepest, steepest),
        "angular velocity": (-FASTEST_TURN, FASTEST_TURN),
        "joint velocity": (-FASTEST_JOINT, FASTEST_JOINT),
        "base velocity": (-FASTEST_TRUNK, FASTEST_TRUNK),
        "machine state": (0.0, 1.0),
        "iterations": (0.0, float(gait.dwell[1] + OVERDUE)),
        "commanded iterations": (float(gait.dwell[0]), float(gait.dwell[1])),
        "foot height": FOOT_HEIGHTS,
    }
    return ranges[entry.group]
