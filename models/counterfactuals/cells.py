"""Choices of cells: between the cuts of tables and trees no target changes."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.question import TOLERANCE, Answer, Question, answered

_INSIDE = 1e-6
"""How far inside a cell, from its edge, an observation is put (spreads)."""

SLACK = 1e-6
"""What is asked beyond the question, since the solver's constraints hold to this (rad)."""

_GAP = 1.0 - (1.0 + 0.95 * TOLERANCE) ** -2
"""Gap of the squared distance at which the solver ends."""

_NODES = 200
"""Nodes after which it ends with the gap that it then has."""

_INFEASIBLE = 2

Indices = NDArray[np.intp]


@dataclass(frozen=True)
class Cells:
    """The cells of one free observation.

    Attributes:
        index: Which observation.
        values: A value in each cell, close to the nearest (c).
        squared: Squared distance of each cell from what was observed (c, in spreads).
        here: The cell of what was observed.
    """

    index: int
    values: Array
    squared: Array
    here: int


def cells_of(question: Question, index: int, cuts: Array) -> Cells:
    """Cuts the range of a free observation into cells.

    Args:
        question: The question.
        index: The observation.
        cuts: Its cuts, in any order.
    """
    room, observed = question.room, question.observation[index]
    low, high = min(room.lower[index], observed), max(room.upper[index], observed)
    inner = np.unique(cuts[(cuts > low) & (cuts < high)])
    left, right = np.append(low, inner), np.append(inner, high)
    inside = np.minimum(_INSIDE * room.spread[index], 0.5 * (right - left))
    values = np.clip(observed, left + inside, right - inside)
    squared = (np.clip(observed, left, right) - observed) ** 2 / room.spread[index] ** 2
    here = int(np.searchsorted(inner, observed))
    # What was observed may lie on a cut itself, and belongs to one side: the policy knows which.
    values[here] = observed
    return Cells(index, values, squared, here)


Chosen = dict[int, int]
"""Cells that are moved to, by the place of their observation among the free ones."""


class CellSearch(ABC):
    """Looks for answers among the choices of a cell for each free observation."""

    def __init__(self, question: Question, cuts: Sequence[Array]) -> None:
        """
        Args:
            question: The question.
            cuts: Cuts of every observation (n arrays), in any order.
        """
        self._question = question
        self._cells = [cells_of(question, int(i), cuts[i]) for i in question.room.free]
        self._here = np.array([own.here for own in self._cells], dtype=np.intp)

    @abstractmethod
    def _rise(self, chosen: Indices) -> float:
        """Returns by how much the target goes the way that was asked (rad), for a choice (k)."""

    @abstractmethod
    def _farthest(self) -> Indices:
        """Returns a choice that lets the target go far, whatever its distance (k)."""

    def reach(self) -> float:
        """Returns the greatest rise that is found (rad)."""
        return self._rise(self._farthest())

    def _does(self, chosen: Indices) -> bool:
        return self._rise(chosen) >= self._question.need

    def _squared(self, chosen: Indices) -> float:
        return float(sum(own.squared[c] for own, c in zip(self._cells, chosen, strict=True)))

    def _observation(self, chosen: Indices) -> Array:
        observation = self._question.observation.copy()
        for own, cell in zip(self._cells, chosen, strict=True):
            observation[own.index] = own.values[cell]
        return observation

    def _answered(self, chosen: Indices, bound: float) -> Answer | None:
        return answered(self._question, self._observation(chosen), bound)

    def _with(self, moves: Chosen) -> Indices:
        """Returns the choice where what does not move is as it was observed (k)."""
        chosen = self._here.copy()
        chosen[list(moves)] = list(moves.values())
        return chosen

    def _priced(
        self, choose: Callable[[float], Indices], least: float, count: int
    ) -> Indices | None:
        """Returns the nearest choice that does what is asked, among those of several prices.

        Args:
            choose: Chooses cells of small distance and great gain, at a price of distance.
            least: The least price; the greatest is 1000.
            count: How many prices are tried, by halving the way to the one that does.
        """
        best, low, high = None, least, 1e3
        for _ in range(count):
            price = float(np.sqrt(low * high))
            chosen = choose(price)
            if not self._does(chosen):
                low = price
                continue
            high = price
            if best is None or self._squared(chosen) < self._squared(best):
                best = chosen
        return best


def nearest_single(cells: Sequence[Cells], gains: Sequence[Array], need: float) -> Chosen | None:
    """Returns the nearest single move that gains enough, or None.

    Args:
        cells: Cells of each free observation (k).
        gains: What each cell gains alone (k arrays).
        need: What must be gained.
    """
    found: tuple[float, Chosen | None] = (np.inf, None)
    for place, (own, gain) in enumerate(zip(cells, gains, strict=True)):
        squared = np.where(gain >= need, own.squared, np.inf)
        best = int(squared.argmin())
        if squared[best] < found[0]:
            found = float(squared[best]), {place: best}
    return found[1]


def nearest_pair(
    cells: Sequence[Cells],
    gains: Sequence[Array],
    need: float,
    extra: Mapping[tuple[int, int], Array],
) -> Chosen | None:
    """Returns the nearest two moves that gain enough together, or None.

    Args:
        cells: Cells of each free observation (k).
        gains: What each cell gains alone (k arrays).
        need: What must be gained.
        extra: What two cells gain together beyond that, of the pairs of observations where there
            is such.
    """
    found: tuple[float, Chosen | None] = (np.inf, None)
    fronts = [_front(own, gain) for own, gain in zip(cells, gains, strict=True)]
    for first, second in combinations(range(len(cells)), 2):
        own = extra.get((first, second))
        rows, columns = fronts[first], fronts[second]
        if own is not None:
            rows, columns = (np.arange(len(gains[place])) for place in (first, second))
        gain = gains[first][rows, None] + gains[second][columns]
        if own is not None:
            gain = gain + own
        squared = cells[first].squared[rows, None] + cells[second].squared[columns]
        squared = np.where(gain >= need, squared, np.inf)
        best = np.unravel_index(squared.argmin(), squared.shape)
        if squared[best] < found[0]:
            found = float(squared[best]), {first: int(rows[best[0]]), second: int(columns[best[1]])}
    return found[1]


def _front(cells: Cells, gain: Array) -> Indices:
    """Returns the cells that gain more than any that is as near."""
    order = np.lexsort((-gain, cells.squared))
    most = np.maximum.accumulate(gain[order])
    return order[np.flatnonzero(np.diff(most, prepend=-np.inf) > 0)]


class Program:
    """Minimizes a sum of costs; HiGHS solves it."""

    def __init__(self) -> None:
        self._costs: list[Array] = []
        self._whole: list[NDArray[np.bool_]] = []
        self._entries: list[tuple[Indices, Indices, Array]] = []
        self._limits: list[tuple[Array, Array]] = []
        self._n_variables = self._n_rows = 0

    def add_variables(self, costs: Array, *, whole: bool) -> Indices:
        """Adds variables of these costs, 0 or more, and returns their numbers.

        Args:
            costs: Their costs (m).
            whole: Whether each must be 0 or 1, and nothing between.
        """
        self._costs.append(costs)
        self._whole.append(np.full(len(costs), whole))
        self._n_variables += len(costs)
        return np.arange(self._n_variables - len(costs), self._n_variables)

    def add_rows(
        self,
        count: int,
        entries: Sequence[tuple[Indices, Indices, float | Array]],
        limits: tuple[float, float],
    ) -> None:
        """Asks that sums of weighted variables lie within limits.

        Args:
            count: Number of sums.
            entries: Sums, numbers of variables and their weights.
            limits: The least and the greatest that each sum may be.
        """
        for rows, columns, weights in entries:
            whole = np.broadcast_to(weights, len(columns)).astype(float)
            self._entries.append((self._n_rows + rows, columns, whole))
        self._limits.append((np.full(count, limits[0]), np.full(count, limits[1])))
        self._n_rows += count

    def solve(self, farthest: float) -> tuple[Array | None, float]:
        """Solves the program.

        Args:
            farthest: What was left out costs more than this; infinite where nothing was.

        Returns:
            The variables, if a solution was found, and a bound that the costs are not below.
        """
        parts = zip(*self._entries, strict=True)
        rows, columns, weights = (np.concatenate(part) for part in parts)
        shape = self._n_rows, self._n_variables
        matrix = coo_array((weights, (rows, columns)), shape=shape).tocsr()
        least, greatest = (np.concatenate(part) for part in zip(*self._limits, strict=True))
        # SciPy's stubs say that limits are numbers; they are arrays as well.
        limits: tuple[Any, Any] = least, greatest
        result = milp(
            np.concatenate(self._costs),
            constraints=LinearConstraint(matrix, *limits),
            integrality=np.concatenate(self._whole).astype(int),
            bounds=Bounds(0, 1),
            options={"mip_rel_gap": _GAP, "node_limit": _NODES},
        )
        if result.status == _INFEASIBLE:
            return None, farthest
        return result.x, min(max(float(result.mip_dual_bound or 0.0), 0.0), farthest)
