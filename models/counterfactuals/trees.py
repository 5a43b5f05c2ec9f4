"""The nearest answer of boosted trees: one that is near, then mixed-integer programming."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.cells import (
    SLACK,
    Cells,
    CellSearch,
    Indices,
    Program,
    nearest_pair,
    nearest_single,
)
from glassgait.models.counterfactuals.question import Answer, Question
from glassgait.models.policies.boosting import BoostedTreesPolicy

_PRICES = 16
"""Prices of distance that are tried."""

_MOST_LEAVES = 2500
"""Leaves with which the program takes a second or two; with more it is not tried."""

_STEPS = 12
"""Steps by which an answer is brought nearer, at most."""


class TreeSearch(CellSearch):
    """Looks for a near answer of boosted trees.

    Moves of several observations do more or less than each alone, so what is found is tried on the
    trees, then brought nearer.
    """

    def __init__(self, question: Question) -> None:
        self._forest = Forest(question)
        super().__init__(question, self._forest.cuts())
        self._alone = self._forest.alone(question.observation, self._cells)

    def nearest(self) -> Answer | None:
        """Returns the nearest answer, with a bound of how near another might be; None if none.

        Where nothing is found by going along single moves, nothing else is tried.
        """
        chosen = self._priced(self._cheapest, 1e-3, _PRICES)
        if chosen is None:
            chosen = self._farthest()
            if not self._does(chosen):
                return None
        chosen = self._brought_nearer(chosen)
        farthest = self._squared(chosen)
        # Few leaves are as near as an answer that there is.
        leaves, bound = self._forest.leaves().within(farthest), 0.0
        if len(leaves.trees) <= _MOST_LEAVES:
            need = self._question.need + self._forest.before
            moves, bound = nearest_leaves(leaves, need, farthest)
            found = None if moves is None else self._moved(moves)
            if found is not None and self._does(found) and self._squared(found) < farthest:
                chosen = found
        return self._answered(chosen, float(np.sqrt(bound)))

    def fewest(self) -> Answer | None:
        """Returns the nearest answer that changes one observation, or else a near one of two."""
        need = self._question.need
        chosen = nearest_single(self._cells, self._alone, need)
        if chosen is not None:
            return self._answered(self._with(chosen), np.inf)
        # Two moves may do less together than each alone, so more is asked until they do enough.
        for more in (1.0, 1.1, 1.25, 1.5, 2.0):
            chosen = nearest_pair(self._cells, self._alone, more * need, {})
            if chosen is None:
                return None
            answer = self._answered(self._with(chosen), 0.0)
            if answer is not None:
                return answer
        return None

    def _rise(self, chosen: Indices) -> float:
        return float(self._forest.rise(self._observation(chosen)[None])[0])

    def _moved(self, moves: Array) -> Indices:
        """Returns the cells where free observations have moved past cuts (k; spreads)."""
        chosen = []
        for own, move in zip(self._cells, moves, strict=True):
            toward = np.sign(own.values - own.values[own.here]) == np.sign(move)
            past = np.sqrt(own.squared) >= abs(move) - 1e-9
            there = np.flatnonzero(toward & past)
            chosen.append(own.here if move == 0 else int(there[own.squared[there].argmin()]))
        return np.array(chosen)

    def _farthest(self) -> Indices:
        """Moves one observation after the other to where the target goes farthest."""
        chosen = self._here.copy()
        for _ in range(2 * len(self._cells)):
            tables = self._forest.alone(self._observation(chosen), self._cells)
            place = int(np.argmax([table.max() for table in tables]))
            if tables[place].max() <= 1e-12:
                break
            chosen[place] = tables[place].argmax()
        return chosen

    def _cheapest(self, price: float) -> Indices:
        """Chooses each cell by its distance and what it gains alone, at a price."""
        pairs = zip(self._cells, self._alone, strict=True)
        return np.array([int(np.argmin(own.squared - price * gain)) for own, gain in pairs])

    def _brought_nearer(self, chosen: Indices) -> Indices:
        """Moves observations back, as far as the target allows, where that spares most."""
        need = self._question.need
        for _ in range(_STEPS):
            observation = self._observation(chosen)
            spare = self._rise(chosen) - need
            tables = self._forest.alone(observation, self._cells)
            chosen, before = self._better(chosen, tables, spare), self._squared(chosen)
            if self._squared(chosen) >= before:
                break
        return chosen

    def _better(self, chosen: Indices, tables: list[Array], spare: float) -> Indices:
        """Moves one observation, or one back and one on, to where that is nearer."""
        changes = [
            own.squared - own.squared[cell] for own, cell in zip(self._cells, chosen, strict=True)
        ]
        sizes = [len(change) for change in changes]
        place = np.repeat(np.arange(len(sizes)), sizes)
        cell = np.concatenate([np.arange(size) for size in sizes])
        change, gain = np.concatenate(changes), np.concatenate(tables)
        # The cheapest first step for each that could go with it, then whichever both spare most.
        order = np.argsort(change, kind="stable")
        kept = order[:200]
        most = np.unique(np.concatenate([kept, np.argsort(change - 5.0 * gain)[:200]]))
        together = gain[most][:, None] + gain[most] + spare
        sum_of_changes = change[most][:, None] + change[most]
        sum_of_changes[(together < 0) | (place[most][:, None] == place[most])] = np.inf
        singles = np.where(gain[most] + spare >= 0, change[most], np.inf)
        candidates = [(float(singles.min()), [int(most[singles.argmin()])])]
        for flat in np.argsort(sum_of_changes, axis=None)[:20]:
            a, b = np.unravel_index(flat, sum_of_changes.shape)
            candidates.append((float(sum_of_changes[a, b]), [int(most[a]), int(most[b])]))
        for saved, moves in sorted(candidates, key=lambda candidate: candidate[0]):
            if saved >= 0:
                break
            tried = chosen.copy()
            tried[place[moves]] = cell[moves]
            if self._does(tried):
                return tried
        return chosen


@dataclass(frozen=True)
class Leaves:
    """Leaves that free observations can reach.

    Attributes:
        trees: Tree of each leaf (m), ascending.
        values: What each adds to the target (m; rad), the way that was asked.
        low: The move of each free observation that it lies above (m, k; spreads).
        high: The move that it lies below, or at (m, k).
    """

    trees: Indices
    values: Array
    low: Array
    high: Array

    def within(self, squared: float) -> "Leaves":
        """Leaves out those that are farther."""
        nearest = np.clip(0.0, self.low, self.high)
        kept = (nearest * nearest).sum(axis=1) <= squared
        return Leaves(self.trees[kept], self.values[kept], self.low[kept], self.high[kept])


class Forest:
    """The trees of one joint, for one question."""

    def __init__(self, question: Question) -> None:
        policy, joint = cast(BoostedTreesPolicy, question.policy), question.joint
        self._question, self._policy, self._depth = question, policy, policy.depth
        self._features = policy.features[joint]
        self._thresholds = policy.thresholds[joint]
        self._scale = question.sign * policy.robot.action_scale
        self._values = self._scale * policy.leaves[joint]
        self._free = question.room.free
        self.before = float(self.total(question.observation[None])[0])

    def cuts(self) -> list[Array]:
        """Returns the thresholds of every observation (n arrays)."""
        n = len(self._question.observation)
        finite = np.isfinite(self._thresholds)
        features, thresholds = self._features[finite], self._thresholds[finite]
        return [np.unique(thresholds[features == index]) for index in range(n)]

    def total(self, observations: Array) -> Array:
        """Returns the sum of all trees (m; rad), of observations (m, n), the way that was asked."""
        added = self._policy.tree_values(observations, self._question.joint)
        return (self._scale * added).sum(axis=1)

    def rise(self, observations: Array) -> Array:
        """Returns by how much the target goes the way that was asked (m; rad)."""
        return self.total(observations) - self.before

    def alone(self, observation: Array, cells: Sequence[Cells]) -> list[Array]:
        """Returns what each cell of each free observation changes (k arrays; rad).

        All trees are gone through for all observations at once: a node that asks for the
        observation that moves is left by both sides.

        Args:
            observation: Where all others stay (n).
            cells: Cells of each free observation (k).
        """
        n_trees, k = len(self._features), len(self._free)
        tree, mover = (part.ravel() for part in np.indices((n_trees, k)))
        node = np.zeros(len(tree), dtype=np.intp)
        low, high = np.full(len(tree), -np.inf), np.full(len(tree), np.inf)
        for _ in range(self._depth):
            asked, cut = self._features[tree, node], self._thresholds[tree, node]
            both = (asked == self._free[mover]) & np.isfinite(cut)
            right = np.where(both, high > cut, observation[asked] > cut)
            left = np.where(both, low < cut, ~right)
            down, up = np.flatnonzero(left), np.flatnonzero(right)
            highest = np.where(both, np.minimum(high, cut), high)[down]
            lowest = np.where(both, np.maximum(low, cut), low)[up]
            tree, mover = np.append(tree[down], tree[up]), np.append(mover[down], mover[up])
            low, high = np.append(low[down], lowest), np.append(highest, high[up])
            node = np.append(2 * node[down] + 1, 2 * node[up] + 2)
        values = self._values[tree, node - (2**self._depth - 1)]
        found = []
        for place, own in enumerate(cells):
            mine = mover == place
            # A leaf counts from the first value above its lower end up to its upper end.
            start = np.searchsorted(own.values, low[mine], side="right")
            end = np.searchsorted(own.values, high[mine], side="right")
            size = len(own.values) + 1
            steps = np.bincount(start, values[mine], size) - np.bincount(end, values[mine], size)
            gain = np.cumsum(steps)[:-1]
            at = np.searchsorted(own.values, observation[own.index])
            found.append(gain - gain[min(at, len(gain) - 1)])
        return found

    def leaves(self) -> Leaves:
        """Returns all leaves that the free observations can reach within their range."""
        observation, room = self._question.observation, self._question.room
        low, high = observation.copy(), observation.copy()
        low[self._free] = np.minimum(room.lower, observation)[self._free]
        high[self._free] = np.maximum(room.upper, observation)[self._free]
        tree = np.arange(len(self._features))
        node = np.zeros(len(tree), dtype=np.intp)
        lows, highs = np.tile(low, (len(tree), 1)), np.tile(high, (len(tree), 1))
        for _ in range(self._depth):
            row = np.arange(len(tree))
            asked, cut = self._features[tree, node], self._thresholds[tree, node]
            down = np.flatnonzero(lows[row, asked] <= cut)
            up = np.flatnonzero(highs[row, asked] > cut)
            lowest, highest = lows[up], highs[down]
            lowest[np.arange(len(up)), asked[up]] = np.maximum(lows[up, asked[up]], cut[up])
            ends = np.minimum(highs[down, asked[down]], cut[down])
            highest[np.arange(len(down)), asked[down]] = ends
            lows, highs = np.append(lows[down], lowest, 0), np.append(highest, highs[up], 0)
            tree = np.append(tree[down], tree[up])
            node = np.append(2 * node[down] + 1, 2 * node[up] + 2)
        order = np.argsort(tree, kind="stable")
        free, here, spread = self._free, observation[self._free], room.spread[self._free]
        values = self._values[tree[order], node[order] - (2**self._depth - 1)]
        moves = [(ends[order][:, free] - here) / spread for ends in (lows, highs)]
        return Leaves(tree[order], values, *moves)


def nearest_leaves(leaves: Leaves, need: float, farthest: float) -> tuple[Array | None, float]:
    """Chooses a leaf in every tree so that they add up to enough and agree with one another.

    A cut that an observation goes past is a variable of 0 or 1. A leaf needs the cuts that it lies
    beyond to be passed, and those that it lies before not to be. Leaves need no constraint to be
    whole, for where the cuts are, they are.

    Args:
        leaves: Those that are no farther than an answer that there is.
        need: What they must add up to (rad).
        farthest: Squared distance of that answer, infinite without one.

    Returns:
        The cut up to which each free observation moves (k; spreads), 0 where it stays, if a choice
        was found, and a bound of the squared distance.
    """
    if not len(leaves.trees):
        return None, farthest
    program = Program()
    _, trees = np.unique(leaves.trees, return_inverse=True)
    chosen = program.add_variables(np.zeros(len(trees)), whole=False)
    program.add_rows(int(trees.max()) + 1, [(trees, chosen, 1.0)], (1.0, 1.0))
    every = np.zeros(len(chosen), dtype=np.intp)
    program.add_rows(1, [(every, chosen, leaves.values)], (need + SLACK, np.inf))
    sides = []
    for place, (low, high) in enumerate(zip(leaves.low.T, leaves.high.T, strict=True)):
        up = _add_side(program, trees, chosen, low, high, np.sqrt(farthest))
        # Where an observation goes down, all is as where it goes up, mirrored.
        down = _add_side(program, trees, chosen, -high, -low, np.sqrt(farthest))
        sides += [(place, 1.0, *up), (place, -1.0, *down)]
        either = np.concatenate([numbers[:1] for _, numbers in (up, down)])
        program.add_rows(1, [(np.zeros_like(either), either, 1.0)], (0.0, 1.0))
    solution, bound = program.solve(farthest)
    if solution is None:
        return None, bound
    moves = np.zeros(leaves.low.shape[1])
    for place, sign, cuts, numbers in sides:
        passed = cuts[solution[numbers] > 0.5]
        if len(passed):
            moves[place] = sign * passed[-1]
    return moves, bound


def _add_side(
    program: Program,
    trees: Indices,
    chosen: Indices,
    low: Array,
    high: Array,
    farthest: float,
) -> tuple[Array, Indices]:
    """Adds the cuts that one observation may pass, going one way.

    Args:
        program: What they are added to.
        trees: Tree of each leaf (m).
        chosen: Number of each leaf's variable (m).
        low: Where each leaf begins (m; spreads).
        high: Where it ends (m).
        farthest: How far the observation may go.

    Returns:
        The cuts, from near to far, and the numbers of their variables.
    """
    ends = np.unique(np.concatenate([low, high]))
    cuts = ends[(ends >= 0) & (ends < min(farthest, high.max()))]
    # Each pays for the way from the cut before.
    numbers = program.add_variables(np.diff(cuts * cuts, prepend=0.0), whole=True)
    rows = np.arange(max(len(cuts) - 1, 0))
    order = [(rows, numbers[:-1], 1.0), (rows, numbers[1:], -1.0)]
    program.add_rows(len(rows), order, (0.0, 1.0))
    # The last cut that a leaf lies beyond, and the first that it lies before.
    beyond = np.searchsorted(cuts, low, side="right") - 1
    before = np.searchsorted(cuts, high, side="left")
    for index, within, sign, limits in (
        (beyond, beyond >= 0, -1.0, (-1.0, 0.0)),
        (before, (before < len(cuts)) & (high >= 0), 1.0, (0.0, 1.0)),
    ):
        asked = np.unique(np.stack([trees[within], index[within]]), axis=1)
        tree, cut = asked[:, :, None]
        farther = index >= cut if sign < 0 else index <= cut
        row, leaf = np.nonzero((trees == tree) & farther & within)
        rows = np.arange(asked.shape[1])
        entries = [(row, chosen[leaf], 1.0), (rows, numbers[asked[1]], sign)]
        program.add_rows(len(rows), entries, limits)
    return cuts, numbers
