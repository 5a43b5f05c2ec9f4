"""Bounds of targets that are sums of tables of one or two observations, or sums of trees.

Bounds of tables are exact. Within a coarse bin of each observation the fine ones count by their
greatest value alone. What is left is a sum of tables over pairs of coarse bins, whose maximum is
found by eliminating one observation after another: few pairs meet in each, so that no table grows
large.

A bound of trees is no maximum: trees are bounded each by itself, though they ask for the same
observations.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.certificates.question import BoundQuery, Box, Maximum
from glassgait.models.certificates.rounding import sum_error
from glassgait.models.errors import InputError
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.task.observation import indices_of

P = TypeVar("P", AdditivePolicy, BoostedTreesPolicy)

INSIDE = 1e-9
"""Share of a bin by which a witness stays away from its end, where rounding could leave it."""


SLACK = 1e-12
"""Boxes are wider by it, in the observation's units."""

SAMPLES = 256
SWEEPS = 2
VALUES = 7
"""A witness is sought among random corners, from the best of them quantity by quantity."""


@dataclass(frozen=True)
class _Cells:
    """The bins, fine and coarse, that an observation of a box can be in.

    Attributes:
        first: Least value in each (k).
        last: Greatest value in each (k).
        single: Value of the joint's function of one observation (k).
        coarse: Coarse bin (k).
    """

    first: Array
    last: Array
    single: Array
    coarse: NDArray[np.intp]

    @property
    def middle(self) -> Array:
        """A value within each (k)."""
        return 0.5 * (self.first + self.last)


class _SumTargets(ABC, Generic[P]):
    """Targets whose actions are sums of doubles."""

    def __init__(self, policy: P) -> None:
        self._policy = policy
        self._units = RobotUnits.of(policy.robot, policy.observation_names)
        self._positions = indices_of("joint position", policy.observation_names)

    @abstractmethod
    def _sizes(self, joint: int) -> list[float]:
        """Returns the greatest size of each summand, in actions."""

    def rounding(self, state: int, joint: int, region: Box) -> float:
        # As much again, twice, for the sums of bounds: here, and in a checker.
        return 3.0 * sum_error(self._policy.robot, self._sizes(joint), joint)

    def _constant(self, joint: int) -> float:
        """Returns the target (rad) where the rest of the sum is 0."""
        robot = self._policy.robot
        return robot.default_stance[joint] + robot.action_scale * self._policy.intercepts[joint]


class AdditiveTargets(_SumTargets[AdditivePolicy]):
    """Targets of an additive policy."""

    def __init__(self, policy: AdditivePolicy) -> None:
        """
        Raises:
            InputError: if a pair is of one observation, whose tables are not bounded.
        """
        if np.any(policy.pairs[:, 0] == policy.pairs[:, 1]):
            raise InputError("a pair of the policy is of one observation; nothing is proved of it")
        super().__init__(policy)
        self._n_labels = policy.pair_cuts.shape[1] + 1

    def used(self, state: int, joint: int) -> frozenset[int]:
        policy = self._policy
        single = np.flatnonzero(np.ptp(policy.tables[joint], axis=-1) > 0.0)
        mine = policy.pair_joints == joint
        return frozenset(single.tolist()) | frozenset(policy.pairs[mine].ravel().tolist())

    def _sizes(self, joint: int) -> list[float]:
        policy = self._policy
        single = np.abs(policy.tables[joint]).max(axis=-1).tolist()
        paired = [float(np.abs(table).max()) for _, _, table in self._pairs_of(joint)]
        return [float(policy.intercepts[joint]), *single, *paired]

    def answer(
        self, question: BoundQuery, region: Box, *, gap: float, threshold: float | None = None
    ) -> Maximum:
        cells = [self._cells(i, question.joint, region) for i in range(len(region.lower))]
        if question.of in ("slope", "effect"):
            return self._change(question, cells, region)
        return self._sum(question, cells, region)

    def _sum(self, question: BoundQuery, cells: Sequence[_Cells], region: Box) -> Maximum:
        joint, sign = question.joint, float(question.sign)
        unary, chosen, lost = [], [], 0.0
        for index, own in enumerate(cells):
            values = sign * own.single
            at = own.middle
            if question.of == "offset" and index == self._positions[joint]:
                # The angle counts by itself: the least of a bin for the greatest offset.
                end = own.first if sign > 0 else own.last
                angle = end / self._units.scale[index] + self._units.offset[index]
                values = values - sign * angle / self._policy.robot.action_scale
                at = end + INSIDE * (own.middle - end)
                lost = INSIDE * float(np.max(own.last - own.first) / self._units.scale[index])
            best = np.full(self._n_labels, -np.inf)
            np.maximum.at(best, own.coarse, values)
            inside = own.coarse == np.arange(self._n_labels)[:, None]
            pick = np.argmax(np.where(inside, values, -np.inf), axis=1)
            unary.append(best)
            chosen.append(at[pick])
        pairs = [(first, second, sign * table) for first, second, table in self._pairs_of(joint)]
        value, labels = greatest_sum(unary, pairs)
        observation = np.array([own[label] for own, label in zip(chosen, labels, strict=True)])
        found = float(sign * self._constant(joint) + self._policy.robot.action_scale * value)
        return Maximum(found, found - lost, self._witness(observation, region))

    def change(self, state: int, joint: int, index: int, most: float, region: Box) -> float:
        cells = [self._cells(i, joint, region) for i in range(len(region.lower))]
        apart = most * self._units.scale[index]
        queries = (BoundQuery("effect", state, joint, sign, index) for sign in (1, -1))
        return max(self._change(query, cells, region, apart).bound for query in queries)

    def _change(
        self, question: BoundQuery, cells: Sequence[_Cells], region: Box, apart: float = np.inf
    ) -> Maximum:
        """Bounds the step from a bin to the next, or the change between two bins.

        Args:
            question: What is asked.
            cells: Bins of each observation.
            region: The box.
            apart: Distance of two bins beyond which a change does not count.
        """
        index = question.observation
        if index is None:
            raise AssertionError(f"{question.of} asks for an observation")
        own, sign = cells[index], float(question.sign)
        best, partners = np.zeros((self._n_labels, self._n_labels)), []
        for first, second, table in self._pairs_of(question.joint):
            if index not in (first, second):
                continue
            partner = second if first == index else first
            mine = table if first == index else table.T
            there = np.unique(cells[partner].coarse)
            change = sign * (mine[None, :, there] - mine[:, None, there])
            partners.append((partner, there[np.argmax(change, axis=-1)]))
            best += change.max(axis=-1)
        # From row to column.
        whole = sign * (own.single[None, :] - own.single[:, None])
        whole = whole + best[np.ix_(own.coarse, own.coarse)]
        if question.of == "slope":
            steps = np.arange(len(own.first) - 1)
            allowed = np.full_like(whole, -np.inf)
            allowed[steps, steps + 1] = whole[steps, steps + 1]
            whole = allowed if len(steps) else np.zeros_like(whole)
        distance = np.maximum(own.first[None, :] - own.last[:, None], 0.0)
        distance = np.maximum(distance, own.first[:, None] - own.last[None, :])
        whole = np.where(distance <= apart + INSIDE, whole, -np.inf)
        before, after = np.unravel_index(int(np.argmax(whole)), whole.shape)
        observation = np.array([each.middle[0] for each in cells])
        observation[index] = own.middle[after]
        for partner, choice in partners:
            label = choice[own.coarse[before], own.coarse[after]]
            theirs = cells[partner]
            observation[partner] = theirs.middle[np.flatnonzero(theirs.coarse == label)[0]]
        found = float(self._policy.robot.action_scale * whole[before, after])
        witness = self._witness(observation, region)
        observation[index] = own.middle[before]
        other = self._witness(observation, region)[index]
        return Maximum(found, found, np.append(witness, other))

    def _witness(self, observation: Array, region: Box) -> Array:
        """Returns the quantities, in the box and with whole counts in spite of rounding."""
        quantities = self._units.quantities(observation)
        counted = list(region.counted)
        quantities[counted] = np.round(quantities[counted])
        return np.clip(quantities, region.lower, region.upper)

    def _pairs_of(self, joint: int) -> list[tuple[int, int, Array]]:
        policy = self._policy
        mine = np.flatnonzero(policy.pair_joints == joint)
        return [(*policy.pairs[number].tolist(), policy.pair_tables[number]) for number in mine]

    def _cells(self, index: int, joint: int, region: Box) -> _Cells:
        policy, units = self._policy, self._units
        ends = np.array([region.lower[index], region.upper[index]])
        low, high = (ends - units.offset[index]) * units.scale[index]
        if index in region.counted:
            counts = np.arange(region.lower[index], region.upper[index] + 1.0)
            first = last = counts * units.scale[index]
        else:
            cuts = np.concatenate([policy.cuts[index], policy.pair_cuts[index]])
            first = np.unique([low, *cuts[(cuts > low) & (cuts <= high)]])
            last = np.append(np.nextafter(first[1:], -np.inf), high)
        fine = np.searchsorted(policy.cuts[index], first, side="right")
        coarse = np.searchsorted(policy.pair_cuts[index], first, side="right")
        return _Cells(first, last, policy.tables[joint, index, fine], coarse)


class TreeTargets(_SumTargets[BoostedTreesPolicy]):
    """Targets of a policy of boosted trees."""

    def used(self, state: int, joint: int) -> frozenset[int]:
        policy = self._policy
        asked = np.isfinite(policy.thresholds[joint])
        return frozenset(policy.features[joint][asked].tolist())

    def _sizes(self, joint: int) -> list[float]:
        leaves = np.abs(self._policy.leaves[joint]).max(axis=-1)
        return [float(self._policy.intercepts[joint]), *leaves.tolist()]

    def answer(
        self, question: BoundQuery, region: Box, *, gap: float, threshold: float | None = None
    ) -> Maximum:
        joint, sign = question.joint, float(question.sign)
        least, most = self._ends_of_trees(joint, region)
        if question.of in ("slope", "effect"):
            return self._change(question, region, most - least)
        ends = most if sign > 0 else -least
        bound = sign * self._constant(joint) + self._policy.robot.action_scale * ends.sum()
        if question.of == "offset":
            angle = region.lower if sign > 0 else -region.upper
            bound -= angle[self._positions[joint]]
        witness, reached = self._witness(question, region)
        return Maximum(float(max(bound, reached)), reached, witness)

    def change(self, state: int, joint: int, index: int, most: float, region: Box) -> float:
        question = BoundQuery("effect", state, joint, 1, index)
        return self.answer(question, region, gap=0.0).bound

    def _change(self, question: BoundQuery, region: Box, spans: Array) -> Maximum:
        """Bounds an effect by the trees that ask for the observation; it bounds steps too."""
        policy, joint = self._policy, question.joint
        asks = policy.features[joint] == question.observation
        asks &= np.isfinite(policy.thresholds[joint])
        bound = self._policy.robot.action_scale * float(spans[asks.any(axis=-1)].sum())
        return Maximum(bound, 0.0, np.append(region.lower, region.lower[question.observation]))

    def _ends_of_trees(self, joint: int, region: Box) -> tuple[Array, Array]:
        """Returns the least and the greatest leaf that each tree can reach (n_trees, n_trees)."""
        policy = self._policy
        lower, upper = self._units.observed(np.array([region.lower, region.upper]))
        lower, upper = lower - SLACK, upper + SLACK
        features, thresholds = policy.features[joint], policy.thresholds[joint]
        reached = np.ones((len(features), 1), dtype=bool)
        # A box is one of nodes, so that a leaf below two questions of one observation may be
        # counted in though no observation of the box falls into it.
        for level in range(policy.depth):
            nodes = slice(2**level - 1, 2 ** (level + 1) - 1)
            left = reached & (lower[features[:, nodes]] <= thresholds[:, nodes])
            right = reached & (upper[features[:, nodes]] > thresholds[:, nodes])
            reached = np.stack([left, right], axis=-1).reshape(len(features), -1)
        leaves = policy.leaves[joint]
        least = np.where(reached, leaves, np.inf).min(axis=-1)
        return least, np.where(reached, leaves, -np.inf).max(axis=-1)

    def _witness(self, question: BoundQuery, region: Box) -> tuple[Array, float]:
        generator = np.random.default_rng(question.joint)
        shape = (SAMPLES, len(region.lower))
        points = np.where(generator.integers(0, 2, shape) == 1, region.upper, region.lower)
        values = self._values(question, points)
        point, value = points[np.argmax(values)], float(values.max())
        for _ in range(SWEEPS):
            for index in sorted(self.used(question.state, question.joint)):
                tried = np.linspace(region.lower[index], region.upper[index], VALUES)
                tried = np.unique(np.floor(tried)) if index in region.counted else tried
                moved = np.tile(point, (len(tried), 1))
                moved[:, index] = tried
                values = self._values(question, moved)
                if values.max() > value:
                    point, value = moved[np.argmax(values)], float(values.max())
        return point, value

    def _values(self, question: BoundQuery, quantities: Array) -> Array:
        """Evaluates what is asked (m,), of quantities (m, n), for the joint alone."""
        policy, joint = self._policy, question.joint
        added = policy.tree_values(self._units.observed(quantities), joint)
        action = added.sum(axis=-1) + policy.intercepts[joint]
        values = self._policy.robot.default_stance[joint] + self._policy.robot.action_scale * action
        if question.of == "offset":
            values = values - quantities[..., self._positions[joint]]
        return question.sign * values


LARGEST = 2**23
"""Greatest number of entries of a table."""

Table = tuple[tuple[int, ...], Array]
"""Labels that a table is of, and its values, an axis a label."""


def greatest_sum(
    unary: Sequence[Array], pairs: Iterable[tuple[int, int, Array]]
) -> tuple[float, NDArray[np.intp]]:
    """Finds labels whose sum of tables is greatest.

    Args:
        unary: Values of each label (n arrays); -inf where a label cannot be chosen.
        pairs: Two labels, and the table of both.

    Returns:
        The greatest sum, and the label of each (n).
    """
    pairs = list(pairs)
    kept = _unbeaten(unary, pairs)
    tables: list[Table] = [((i,), own[kept[i]]) for i, own in enumerate(unary)]
    tables += [((a, b), table[np.ix_(kept[a], kept[b])]) for a, b, table in pairs]
    value, chosen = _solve(tables, [len(own) for own in kept])
    labels = [own[chosen[i]] for i, own in enumerate(kept)]
    return value, np.array(labels, dtype=np.intp)


def _unbeaten(
    unary: Sequence[Array], pairs: Iterable[tuple[int, int, Array]]
) -> list[NDArray[np.intp]]:
    """Lists the values of each label that no other value beats, whatever the other labels are.

    This is the elimination of dead ends with the criterion of R. F. Goldstein, *Efficient rotamer
    elimination applied to protein side-chains and related spin glasses*, Biophysical Journal 66
    (1994).
    """
    kept = [np.flatnonzero(own > -np.inf) for own in unary]
    met: list[list[tuple[int, Array]]] = [[] for _ in unary]
    for one, two, table in pairs:
        met[one].append((two, table))
        met[two].append((one, table.T))
    left = set(range(len(unary)))
    while left:
        label = left.pop()
        own = unary[label][kept[label]]
        # What changing from the row's value to the column's gains at least.
        gain = own[None, :] - own[:, None]
        for other, table in met[label]:
            values = table[np.ix_(kept[label], kept[other])]
            gain = gain + (values[None, :] - values[:, None]).min(axis=-1)
        np.fill_diagonal(gain, -np.inf)
        best = np.ones(len(own), dtype=bool)
        for value, gains in enumerate(gain):
            # Of two that are equally good one stays.
            best[value] = not (gains[best] >= 0.0).any()
        if not best.all():
            kept[label] = kept[label][best]
            left.update(other for other, _ in met[label])
    return kept


def _solve(tables: list[Table], sizes: Sequence[int]) -> tuple[float, dict[int, int]]:
    """Returns the greatest sum of tables, and the labels that they are of."""
    steps = []
    while labels := {label for axes, _ in tables for label in axes}:
        cost, label = min((_cost(own, tables, sizes), own) for own in labels)
        if cost > LARGEST:
            value, chosen = _tried(tables, sizes)
            break
        axes, whole = _summed([table for table in tables if label in table[0]], label)
        steps.append((label, axes, np.argmax(whole, axis=0)))
        tables = [table for table in tables if label not in table[0]]
        tables.append((axes, whole.max(axis=0)))
    else:
        value, chosen = float(sum(values for _, values in tables)), {}
    for label, axes, best in reversed(steps):
        chosen[label] = int(best[tuple(chosen[axis] for axis in axes)])
    return value, chosen


def _tried(tables: list[Table], sizes: Sequence[int]) -> tuple[float, dict[int, int]]:
    """Tries each value of the label that meets most others."""
    labels = {label for axes, _ in tables for label in axes}
    most = max(labels, key=lambda own: (sum(own in axes for axes, _ in tables), -own))
    found = [
        _solve([_cut(table, most, value) for table in tables], sizes)
        for value in range(sizes[most])
    ]
    best = max(range(len(found)), key=lambda value: found[value][0])
    return found[best][0], {**found[best][1], most: best}


def _cut(table: Table, label: int, value: int) -> Table:
    axes, values = table
    if label not in axes:
        return table
    left = np.asarray(values.take(value, axes.index(label)))
    return tuple(axis for axis in axes if axis != label), left


def _cost(label: int, tables: Sequence[Table], sizes: Sequence[int]) -> int:
    met = {other for axes, _ in tables if label in axes for other in axes}
    return int(np.prod([sizes[other] for other in met], dtype=float))


def _summed(tables: Sequence[Table], label: int) -> tuple[tuple[int, ...], Array]:
    """Adds tables, the label's axis first; returns the other labels and the sum."""
    others = sorted({axis for axes, _ in tables for axis in axes} - {label})
    order = [label, *others]
    whole: Array | float = 0.0
    for axes, values in tables:
        places = [order.index(axis) for axis in axes]
        shape = [1] * len(order)
        for place, size in zip(places, values.shape, strict=True):
            shape[place] = size
        whole = whole + values.transpose(np.argsort(places)).reshape(shape)
    return tuple(others), np.asarray(whole)
