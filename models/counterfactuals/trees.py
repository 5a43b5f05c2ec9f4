"""The nearest answer of boosted trees: one that is near, then mixed-integer programming."""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.cells import Chosen, cells_of, nearest_pair, nearest_single
from glassgait.models.counterfactuals.forest import Forest, nearest_leaves
from glassgait.models.counterfactuals.question import Answer, Question, answered

_PRICES = 16
"""Prices of distance that are tried."""

_MOST_LEAVES = 2500
"""Leaves with which the program takes a second or two; with more it is not tried."""

_STEPS = 12
"""Steps by which an answer is brought nearer, at most."""


class TreeSearch:
    """Looks for a near answer of boosted trees.

    Where no observation leaves its cell no target changes. Moves of several observations do more or
    less than each alone, so what is found is tried on the trees, then brought nearer.
    """

    def __init__(self, question: Question) -> None:
        self._question = question
        self._forest = Forest(question)
        self._cells = cells_of(question, self._forest.cuts())
        self._alone = self._forest.alone(question.observation, self._cells)

    def nearest(self) -> Answer | None:
        """Returns the nearest answer, with a bound of how near another might be; None if none.

        Where nothing is found by going along single moves, nothing else is tried.
        """
        chosen = self._priced()
        if chosen is None:
            chosen = self._climbed()
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
        return answered(self._question, self._observation(chosen), float(np.sqrt(bound)))

    def fewest(self) -> Answer | None:
        """Returns the nearest answer that changes one observation, or else a near one of two."""
        need = self._question.need
        chosen = nearest_single(self._cells, self._alone, need)
        if chosen is not None:
            return self._answer_of(chosen, np.inf)
        # Two moves may do less together than each alone, so more is asked until they do enough.
        for more in (1.0, 1.1, 1.25, 1.5, 2.0):
            chosen = nearest_pair(self._cells, self._alone, more * need, {})
            if chosen is None:
                return None
            answer = self._answer_of(chosen, 0.0)
            if answer is not None:
                return answer
        return None

    def reach(self) -> float:
        """Returns the greatest rise that is found (rad)."""
        return float(self._forest.rise(self._observation(self._climbed())[None])[0])

    def _answer_of(self, chosen: Chosen, bound: float) -> Answer | None:
        whole = np.array([own.here for own in self._cells])
        whole[list(chosen)] = list(chosen.values())
        return answered(self._question, self._observation(whole), bound)

    def _observation(self, chosen: Array) -> Array:
        observation = self._question.observation.copy()
        for own, cell in zip(self._cells, chosen, strict=True):
            observation[own.index] = own.values[cell]
        return observation

    def _moved(self, moves: Array) -> Array:
        """Returns the cells where free observations have moved past cuts (k; spreads)."""
        chosen = []
        for own, move in zip(self._cells, moves, strict=True):
            toward = np.sign(own.values - own.values[own.here]) == np.sign(move)
            past = np.sqrt(own.squared) >= abs(move) - 1e-9
            there = np.flatnonzero(toward & past)
            chosen.append(own.here if move == 0 else int(there[own.squared[there].argmin()]))
        return np.array(chosen)

    def _squared(self, chosen: Array) -> float:
        return float(sum(own.squared[c] for own, c in zip(self._cells, chosen, strict=True)))

    def _climbed(self) -> Array:
        """Moves one observation after the other to where the target goes farthest."""
        chosen = np.array([own.here for own in self._cells])
        for _ in range(2 * len(self._cells)):
            tables = self._forest.alone(self._observation(chosen), self._cells)
            place = int(np.argmax([table.max() for table in tables]))
            if tables[place].max() <= 1e-12:
                break
            chosen[place] = tables[place].argmax()
        return chosen

    def _does(self, chosen: Array) -> bool:
        rise = self._forest.rise(self._observation(chosen)[None])[0]
        return bool(rise >= self._question.need)

    def _priced(self) -> Array | None:
        """Chooses each cell by its distance and what it does alone, at the price that does it."""
        best, low, high = None, 1e-3, 1e3
        for _ in range(_PRICES):
            price = np.sqrt(low * high)
            chosen = np.array(
                [
                    int(np.argmin(own.squared - price * gain))
                    for own, gain in zip(self._cells, self._alone, strict=True)
                ]
            )
            if self._does(chosen):
                best, high = chosen, price
            else:
                low = price
        return best

    def _brought_nearer(self, chosen: Array) -> Array:
        """Moves observations back, as far as the target allows, where that spares most."""
        need = self._question.need
        for _ in range(_STEPS):
            observation = self._observation(chosen)
            spare = float(self._forest.rise(observation[None])[0]) - need
            tables = self._forest.alone(observation, self._cells)
            chosen, before = self._better(chosen, tables, spare), self._squared(chosen)
            if self._squared(chosen) >= before:
                break
        return chosen

    def _better(self, chosen: Array, tables: list[Array], spare: float) -> Array:
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
