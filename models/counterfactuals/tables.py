"""The nearest answer of an additive model, by mixed-integer programming."""

from dataclasses import dataclass
from typing import cast

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.cells import (
    SLACK,
    CellSearch,
    Indices,
    Program,
    nearest_pair,
    nearest_single,
)
from glassgait.models.counterfactuals.question import Answer, Question
from glassgait.models.policies.additive import AdditivePolicy

_PRICES = 14
"""Prices of distance that descents are tried with."""

_SWEEPS = 6
"""Sweeps of a descent, at most."""


@dataclass(frozen=True)
class _Pair:
    """A function of two free observations.

    Attributes:
        places: Their places among the free observations.
        table: What two bins add to the target (d, d; rad), the way that was asked.
        bins: The bin of each cell, of the first and of the second.
    """

    places: tuple[int, int]
    table: Array
    bins: tuple[Indices, Indices]


class AdditiveSearch(CellSearch):
    """Looks for the nearest answer of an additive model."""

    def __init__(self, question: Question) -> None:
        policy = cast(AdditivePolicy, question.policy)
        cuts = [np.concatenate(own) for own in zip(policy.cuts, policy.pair_cuts, strict=True)]
        super().__init__(question, cuts)
        scale = question.sign * question.policy.robot.action_scale
        self._gains = [
            scale
            * policy.tables[question.joint, own.index][
                np.searchsorted(policy.cuts[own.index], own.values, side="right")
            ]
            for own in self._cells
        ]
        self._pairs: list[_Pair] = []
        place_of = {own.index: place for place, own in enumerate(self._cells)}
        for number in np.flatnonzero(policy.pair_joints == question.joint):
            table = scale * policy.pair_tables[number]
            self._add_pair(policy, policy.pairs[number].tolist(), table, place_of)
        for place, own in enumerate(self._here):
            self._gains[place] = self._gains[place] - self._gains[place][own]
        self._before = sum(self._of_pair(pair, self._here) for pair in self._pairs)

    def nearest(self) -> Answer | None:
        """Returns the nearest answer, with a bound of how near another might be; None if none."""
        if self._most() < self._question.need:
            return None
        chosen = self._priced(self._descended, 1e-2, _PRICES)
        if chosen is None and self._does(most := self._farthest()):
            chosen = most
        found, bound = self._solved(np.inf if chosen is None else self._squared(chosen))
        if found is not None and (chosen is None or self._squared(found) < self._squared(chosen)):
            chosen = found
        return None if chosen is None else self._answered(chosen, float(np.sqrt(max(bound, 0.0))))

    def fewest(self) -> Answer | None:
        """Returns the nearest answer that changes one observation, or else two; None if none."""
        gains = [self._alone(place) for place in range(len(self._cells))]
        need = self._question.need
        chosen = nearest_single(self._cells, gains, need)
        if chosen is None:
            extra: dict[tuple[int, int], Array] = {}
            for pair in self._pairs:
                first, second = pair.places
                joint = self._beyond(pair)
                if first > second:
                    first, second, joint = second, first, joint.T
                extra[first, second] = extra.get((first, second), 0.0) + joint
            chosen = nearest_pair(self._cells, gains, need, extra)
        return None if chosen is None else self._answered(self._with(chosen), np.inf)

    def _add_pair(
        self, policy: AdditivePolicy, indices: list[int], table: Array, place_of: dict[int, int]
    ) -> None:
        """Keeps a function of two observations; of one, where the other is held."""
        bins = []
        for index in indices:
            free = index in place_of
            values = self._cells[place_of[index]].values if free else self._question.observation
            values = values if free else values[[index]]
            bins.append(np.searchsorted(policy.pair_cuts[index], values, side="right"))
        match [place_of.get(index) for index in indices]:
            case [int() as first, int() as second]:
                self._pairs.append(_Pair((first, second), table, (bins[0], bins[1])))
            case [int() as place, None]:
                self._gains[place] = self._gains[place] + table[bins[0], bins[1]]
            case [None, int() as place]:
                self._gains[place] = self._gains[place] + table[bins[0], bins[1]]

    def _rise(self, chosen: Indices) -> float:
        alone = sum(gain[cell] for gain, cell in zip(self._gains, chosen, strict=True))
        return float(alone + sum(self._of_pair(p, chosen) for p in self._pairs) - self._before)

    def _most(self) -> float:
        """Returns what no rise is above: every table at its greatest (rad)."""
        single = sum(float(gain.max()) for gain in self._gains)
        pairs = sum(float(p.table[np.ix_(*map(np.unique, p.bins))].max()) for p in self._pairs)
        return single + pairs - self._before

    @staticmethod
    def _of_pair(pair: _Pair, chosen: Indices) -> float:
        (first, second), (rows, columns) = pair.places, pair.bins
        return float(pair.table[rows[chosen[first]], columns[chosen[second]]])

    def _alone(self, place: int, chosen: Indices | None = None) -> Array:
        """Returns what each cell of an observation gains while the others are as chosen."""
        chosen = self._here if chosen is None else chosen
        gain = self._gains[place].copy()
        for pair in self._pairs:
            (first, second), (rows, columns) = pair.places, pair.bins
            if place == first:
                gain += pair.table[rows, columns[chosen[second]]]
            elif place == second:
                gain += pair.table[rows[chosen[first]], columns]
        return gain - gain[self._here[place]]

    def _beyond(self, pair: _Pair) -> Array:
        """Returns what two cells gain beyond what each gains alone."""
        (first, second), (rows, columns) = pair.places, pair.bins
        own = pair.table[np.ix_(rows, columns)]
        row, column = self._here[first], self._here[second]
        return own - own[[row]] - own[:, [column]] + own[row, column]

    def _farthest(self) -> Indices:
        return self._descended(np.inf)

    def _descended(self, price: float) -> Indices:
        """Chooses one cell after another by its distance and gain at a price, again and again."""
        chosen = self._here.copy()
        for _ in range(_SWEEPS):
            before = chosen.copy()
            for place, own in enumerate(self._cells):
                squared = 0.0 if np.isinf(price) else own.squared / price
                chosen[place] = np.argmax(self._alone(place, chosen) - squared)
            if np.array_equal(chosen, before):
                break
        return chosen

    def _solved(self, farthest: float) -> tuple[Indices | None, float]:
        """Solves the mixed-integer program over the cells that are no farther.

        Each cell, and each pair of bins, is a variable of 0 or 1; pairs of bins need no constraint
        to be whole, for where the cells are, they are.

        Returns:
            A choice, if one was found, and a bound of its squared distance.
        """
        program, gains = Program(), []
        kept = [np.flatnonzero(own.squared <= farthest) for own in self._cells]
        numbers = []
        for own, mine, gain in zip(self._cells, kept, self._gains, strict=True):
            numbers.append(program.add_variables(own.squared[mine], whole=True))
            gains.append(gain[mine])
            program.add_rows(1, [(np.zeros_like(mine), numbers[-1], 1.0)], (1.0, 1.0))
        for pair in self._pairs:
            bins = [own[kept[place]] for own, place in zip(pair.bins, pair.places, strict=True)]
            (rows, own_rows), (columns, own_columns) = (
                np.unique(own, return_inverse=True) for own in bins
            )
            table = pair.table[np.ix_(rows, columns)]
            both = program.add_variables(np.zeros(table.size), whole=False)
            row, column = (part.ravel() for part in np.indices(table.shape))
            first, second = (numbers[place] for place in pair.places)
            # A bin is chosen as often as all pairs of bins that hold it.
            ties = [(row, both, 1.0), (own_rows, first, -1.0)]
            program.add_rows(len(rows), ties, (0.0, 0.0))
            ties = [(column, both, 1.0), (own_columns, second, -1.0)]
            program.add_rows(len(columns), ties, (0.0, 0.0))
            numbers.append(both)
            gains.append(table.ravel())
        every, gain = np.concatenate(numbers), np.concatenate(gains)
        need = self._question.need + SLACK + self._before
        program.add_rows(1, [(np.zeros_like(every), every, gain)], (need, np.inf))
        solution, bound = program.solve(farthest)
        if solution is None:
            return None, bound
        own = zip(kept, numbers[: len(kept)], strict=True)
        chosen = np.array([mine[np.argmax(solution[number])] for mine, number in own])
        return (chosen if self._does(chosen) else None), bound
