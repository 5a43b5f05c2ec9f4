"""Tables (additive models) and boosted trees: sums of constants on boxes of observations.

Sums are of doubles, here as in the robot: each bound holds twice the error that any order of adding
up can make. Cuts count as met within `NEAR`.
"""

import json
import math
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from flint import arb

from .robot import (
    COUNTED,
    JOINTS,
    BoundQuery,
    Box,
    Robot,
    refuse_unless,
    symbols,
)
from .rounding import of_sum

NEAR, LARGEST, MOST_BRANCHES = 1e-12, 2**23, 100

Table = tuple[tuple[int, ...], Any]
"""Labels that a table is of, and its values, an axis a label."""


def read_arrays(data: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    """Reads a safetensors file: its header and its arrays."""
    (size,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + size])
    contents, arrays = json.loads(header.pop("__metadata__")["header"]), {}
    places = sorted(own["data_offsets"] for own in header.values())
    ends = [0, *(end for _, end in places)]
    tiled = all(start == before for (start, _), before in zip(places, ends, strict=False))
    refuse_unless(tiled and ends[-1] == len(data) - 8 - size, "the policy's arrays overlap")
    for name, own in header.items():
        start, end = own["data_offsets"]
        kind = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "U8": "|u1", "I32": "<i4", "I64": "<i8"}
        flat = np.frombuffer(data[8 + size + start : 8 + size + end], kind[own["dtype"]])
        arrays[name] = flat.astype("<i8" if own["dtype"][0] in "UI" else float)
        arrays[name] = arrays[name].reshape(own["shape"])
    return contents, arrays


class Tables:
    """Targets that are sums of tables of one and of two observations."""

    def __init__(
        self, robot: Robot, arrays: dict[str, Any], n_states: int, imu: bool = False
    ) -> None:
        self.robot, self.arrays, self.names = robot, arrays, symbols(n_states, imu)
        sound = all(np.isfinite(own).all() for name, own in arrays.items() if name in self.summed)
        refuse_unless(sound, "the policy holds what is no number")
        twice = arrays.get("pairs", np.zeros((0, 2)))
        refuse_unless((twice[:, 0] != twice[:, 1]).all(), "a pair is of one observation")

    summed = ("tables", "pair_tables", "intercepts")
    """Arrays of what is added up."""

    def sizes(self, joint: int) -> list[float]:
        """Returns the greatest size of each summand, in actions."""
        single = np.abs(self.arrays["tables"][joint]).max(axis=-1).tolist()
        paired = [float(np.abs(table).max()) for _, table in self.pairs(joint)]
        return [abs(float(self.arrays["intercepts"][joint])), *single, *paired]

    def rounding(self, state: int, joint: str, box: Box) -> arb:
        """Bounds how far a target in double precision may be from the exact one (rad).

        Raises:
            RefusedError: if that is too far.
        """
        return of_sum(self.robot, self.sizes(JOINTS.index(joint)), joint)

    def own_rounding(self, joint: str) -> float:
        """Bounds the error of the sums that are made here (rad)."""
        return 2.0 * float(self.rounding(0, joint, {}).upper())

    def pairs(self, joint: int) -> list[Table]:
        own, mine = self.arrays, np.flatnonzero(self.arrays["pair_joints"] == joint)
        return [(tuple(own["pairs"][one].tolist()), own["pair_tables"][one]) for one in mine]

    def used(self, state: int, joint: str) -> set[str]:
        """Returns the quantities that a target may depend on."""
        number = JOINTS.index(joint)
        single = np.flatnonzero(np.ptp(self.arrays["tables"][number], axis=-1) > 0.0).tolist()
        paired = [index for pair, _ in self.pairs(number) for index in pair]
        return {self.names[index] for index in {*single, *paired}}

    def is_mirrored(self, state: int, joint: str, image: list[int]) -> bool:
        """Returns False: nothing is known of the mirror."""
        return False

    def cells(self, name: str, joint: int, box: Box) -> tuple[Any, Any, Any, Any]:
        """Returns the bins in a box: both ends, values of one observation, labels in pairs."""
        (scale, offset), index = self.robot.units(name), self.names.index(name)
        fine, coarse = (self.arrays[own][index] for own in ("cuts", "pair_cuts"))
        low, high = box[name]
        if name in COUNTED:
            # Policies observe a count as this very product.
            first = last = np.arange(math.ceil(low), math.floor(high) + 1.0) * scale
        else:
            low, high = (low - offset) * scale, (high - offset) * scale
            low, high = low - near(low), high + near(high)
            cuts = np.concatenate([fine, coarse])
            first = np.unique([low, *cuts[(cuts > low) & (cuts <= high)]])
            last = np.append(first[1:], high)
        values = self.arrays["tables"][joint, index, np.searchsorted(fine, first, side="right")]
        return first, last, values, np.searchsorted(coarse, first, side="right")

    def bound(self, asked: BoundQuery, box: Box, splits: list | None = None) -> float:
        """Bounds what is asked from above over a box."""
        if asked.of in ("slope", "effect"):
            return self.change(asked, box, math.inf)
        joint, sign, tables = JOINTS.index(asked.joint), asked.sign, list[Table]()
        for index, name in enumerate(self.names):
            first, last, values, labels = self.cells(name, joint, box)
            values = sign * values
            if asked.of == "offset" and name == f"q.{asked.joint}":
                angle = (first if sign > 0 else last) / self.robot.units(name)[
                    0
                ] + self.robot.units(name)[1]
                values = values - sign * angle / self.robot.action_scale
            unary = np.full(int(labels.max()) + 1, -np.inf)
            np.maximum.at(unary, labels, values)
            tables.append(((index,), unary))
        sizes = [len(unary) for _, unary in tables]
        for (one, two), table in self.pairs(joint):
            tables.append(((one, two), sign * table[: sizes[one], : sizes[two]]))
        constant = self.robot.stance[asked.joint] + self.robot.action_scale * float(
            self.arrays["intercepts"][joint]
        )
        return (
            sign * constant
            + self.robot.action_scale * greatest_sum(tables, sizes)
            + self.own_rounding(asked.joint)
        )

    def change(self, asked: BoundQuery, box: Box, most: float) -> float:
        """Bounds the step from a bin to the next, or the change between bins not too far apart."""
        joint, index = JOINTS.index(asked.joint), self.names.index(str(asked.name))
        first, last, values, labels = self.cells(str(asked.name), joint, box)
        whole = asked.sign * (values[None, :] - values[:, None])
        for pair, table in self.pairs(joint):
            if index in pair:
                other = pair[1 - pair.index(index)]
                there = np.unique(self.cells(self.names[other], joint, box)[3])
                mine = (table if pair[0] == index else table.T)[labels][:, there]
                whole = whole + (asked.sign * (mine[None] - mine[:, None])).max(axis=-1)
        if asked.of == "slope":
            # Within one bin nothing changes.
            whole = np.diagonal(whole, 1) if len(first) > 1 else np.zeros(1)
        else:
            apart = np.maximum(first[None, :] - last[:, None], first[:, None] - last[None, :])
            whole = whole[apart <= most * self.robot.units(str(asked.name))[0] + 1e-9]
        return self.robot.action_scale * float(whole.max()) + self.own_rounding(asked.joint)

    def moved(self, state: int, joint: str, name: str, most: float, box: Box) -> float:
        """Bounds the change of a target where a quantity changes by `most` at most."""
        asked = [BoundQuery("effect", state, joint, sign, name) for sign in (1, -1)]
        return max(self.change(one, box, most) for one in asked)


def near(value: Any) -> Any:
    """Returns by how much a cut may be missed: rounding of what is observed, and of the cut."""
    return NEAR + 2.0**-50 * np.where(np.isfinite(value), np.abs(value), 0.0)


def greatest_sum(
    tables: list[Table], sizes: list[int], budget: Iterator[int] | None = None
) -> float:
    """Returns the greatest sum of tables, by eliminating one label after another.

    Raises:
        RefusedError: if more than `MOST_BRANCHES` ways must be tried.
    """
    budget = budget or iter(range(MOST_BRANCHES))
    refuse_unless(next(budget, None) is not None, "too many tables meet to be checked")
    while labels := {label for axes, _ in tables for label in axes}:
        met = {own: {x for axes, _ in tables if own in axes for x in axes} for own in labels}
        cost = {own: math.prod(sizes[label] for label in met[own]) for own in labels}
        label = min(labels, key=lambda own: (cost[own], own))
        if cost[label] > LARGEST:
            label = max(labels, key=lambda own: (len(met[own]), own))
            cut = [[held(table, label, value) for table in tables] for value in range(sizes[label])]
            return max(greatest_sum(own, sizes, budget) for own in cut)
        order = [*sorted(met[label] - {label}), label]
        whole = np.zeros([1] * len(order))
        for axes, values in (table for table in tables if label in table[0]):
            places = np.argsort([order.index(axis) for axis in axes])
            shape = [sizes[axis] if axis in axes else 1 for axis in order]
            whole = whole + values.transpose(places).reshape(shape)
        tables = [table for table in tables if label not in table[0]]
        tables.append((tuple(order[:-1]), whole.max(axis=-1)))
    return math.fsum(float(values) for _, values in tables)


def held(table: Table, label: int, value: int) -> Table:
    axes, values = table
    if label not in axes:
        return table
    return tuple(axis for axis in axes if axis != label), values.take(value, axes.index(label))


class Trees(Tables):
    """Targets that are sums of trees, of which each is bounded by itself."""

    def __init__(
        self, robot: Robot, arrays: dict[str, Any], n_states: int, imu: bool = False
    ) -> None:
        super().__init__(robot, arrays, n_states, imu)
        nodes, leaves = arrays["features"].shape[-1], arrays["leaves"].shape[-1]
        whole = leaves == nodes + 1 and leaves >= 2 and leaves & nodes == 0
        refuse_unless(whole, "the policy's trees are not complete")
        # A file may hold the number of single precision below a cut, which is halfway to the next.
        stored = "thresholds" in arrays
        below = above = arrays["thresholds" if stored else "thresholds_lower_neighbours"]
        if not stored:
            single = below.astype(np.float32).astype(float) == below
            refuse_unless(single.all(), "a threshold is no number of single precision")
            above = np.nextafter(below.astype(np.float32), np.float32(np.inf)).astype(float)
        self.cuts = 0.5 * below + 0.5 * above
        refuse_unless(not np.isnan(self.cuts).any(), "the policy holds what is no number")

    summed = ("leaves", "intercepts")

    def sizes(self, joint: int) -> list[float]:
        leaves = np.abs(self.arrays["leaves"][joint]).max(axis=-1)
        return [abs(float(self.arrays["intercepts"][joint])), *leaves.tolist()]

    def used(self, state: int, joint: str) -> set[str]:
        number = JOINTS.index(joint)
        asked = self.arrays["features"][number][np.isfinite(self.cuts[number])]
        return {self.names[index] for index in asked.ravel().tolist()}

    def bound(self, asked: BoundQuery, box: Box, splits: list | None = None) -> float:
        joint, sign = JOINTS.index(asked.joint), asked.sign
        features, leaves = self.arrays["features"][joint], self.arrays["leaves"][joint]
        scaled = [
            (np.array(box[name]) - self.robot.units(name)[1]) * self.robot.units(name)[0]
            for name in self.names
        ]
        lower, upper = np.array(scaled).T
        cuts = self.cuts[joint]
        left = lower[features] <= cuts + near(cuts)
        right = upper[features] > cuts - near(cuts)
        reached = np.ones((len(features), 1), dtype=bool)
        while reached.shape[1] < leaves.shape[1]:
            nodes = slice(reached.shape[1] - 1, 2 * reached.shape[1] - 1)
            both = [reached & left[:, nodes], reached & right[:, nodes]]
            reached = np.stack(both, axis=-1).reshape(len(features), -1)
        most = np.where(reached, sign * leaves, -np.inf).max(axis=-1)
        if asked.of in ("slope", "effect"):
            least = np.where(reached, sign * leaves, np.inf).min(axis=-1)
            asks = features == self.names.index(str(asked.name))
            mine = (asks & np.isfinite(self.cuts[joint])).any(axis=-1)
            return self.robot.action_scale * math.fsum((most - least)[mine]) + self.own_rounding(
                asked.joint
            )
        constant = self.robot.stance[asked.joint] + self.robot.action_scale * float(
            self.arrays["intercepts"][joint]
        )
        whole = (
            sign * constant
            + self.robot.action_scale * math.fsum(most)
            + self.own_rounding(asked.joint)
        )
        if asked.of == "offset":
            whole -= min(sign * end for end in box[f"q.{asked.joint}"])
        return whole

    def change(self, asked: BoundQuery, box: Box, most: float) -> float:
        return self.bound(asked, box)
