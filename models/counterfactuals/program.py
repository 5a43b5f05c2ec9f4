"""A mixed-integer program of variables from 0 to 1, put together piece by piece."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import coo_array

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.question import TOLERANCE

SLACK = 1e-6
"""What is asked beyond the question, since the solver's constraints hold to this (rad)."""

_GAP = 1.0 - (1.0 + 0.95 * TOLERANCE) ** -2
"""Gap of the squared distance at which the solver ends."""

_NODES = 200
"""Nodes after which it ends with the gap that it then has."""

_INFEASIBLE = 2

Indices = NDArray[np.intp]


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
