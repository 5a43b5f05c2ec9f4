"""Where a gait settles: a periodic orbit, one of several strides, or none; and its fixed point."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.stride_map import Map, newton

LONGEST_PERIOD = 4
"""Strides of the longest orbit that is distinguished from one that wanders."""

CLOSED = 1e-3
"""How near an orbit comes back to itself to be called periodic (units of the coordinates)."""

FIXED = 1e-5
"""Residual at which a point is fixed (units of the coordinates)."""

N_AVERAGED = 40
"""Last strides whose mean is where a fixed point is looked for, if the gait did not settle."""

NEWTON_STEP, NEWTON_REACH, N_NEWTON = 3e-3, 2.0, 8
"""Of Newton's method: the differences' size, its longest move (units), and its iterations."""


@dataclass(frozen=True)
class Orbits:
    """Where the gaits of m commands go.

    Attributes:
        last: The orbits' last points (m, d); NaN where the robot fell.
        periods: Strides of each orbit (m,): 1 for a periodic gait, more for one that repeats every
            few strides, 0 for one that wanders, -1 for a robot that fell.
        mean: Their mean points over the last strides (m, d).
        sway: Root mean square of the last points' distance from their mean (m,; units).
        fixed: Fixed points (m, d), attracting or not; NaN where none was found.
        residuals: How far a stride moves them (m,; units).
    """

    last: Array
    periods: NDArray[np.int64]
    mean: Array
    sway: Array
    fixed: Array
    residuals: Array


def find_orbits(step: Map, first: Array, *, n_strides: int, differentiable: bool) -> Orbits:
    """Follows orbits until they settle, and looks for a fixed point of each.

    Args:
        step: The stride map.
        first: Where the orbits begin (m, d), a point a problem; NaN for a robot that fell.
        n_strides: Strides that are followed.
        differentiable: Whether the map has derivatives, by which fixed points are found.
    """
    problems = np.arange(len(first))
    points, kept = first, []
    for _ in range(n_strides):
        points = step(points, problems)
        kept.append(points)
    kept = np.array(kept[-N_AVERAGED:])
    periods = _periods(kept)
    mean = kept.mean(axis=0)
    sway = np.sqrt(np.square(kept - mean).sum(axis=2).mean(axis=0))
    start = np.where((periods == 1)[:, None], points, mean)
    alive = np.flatnonzero((periods >= 0) & differentiable)
    fixed, residuals = np.full_like(first, np.nan), np.full(len(first), np.nan)
    if len(alive):
        found, off = newton(
            lambda x, i: step(x, alive[i]),
            start[alive],
            size=NEWTON_STEP,
            tolerance=0.1 * FIXED,
            n_iterations=N_NEWTON,
            reach=NEWTON_REACH,
        )
        residuals[alive] = off
        fixed[alive] = np.where((off <= FIXED)[:, None], found, np.nan)
    return Orbits(points, periods, mean, sway, fixed, residuals)


def _periods(kept: Array) -> NDArray[np.int64]:
    """Finds the least period of each orbit, from its last points (n, m, d)."""
    periods = np.zeros(kept.shape[1], dtype=np.int64)
    for period in range(min(LONGEST_PERIOD, len(kept) - 1), 0, -1):
        back = np.abs(kept[-1] - kept[-1 - period]).max(axis=1)
        periods[back < CLOSED] = period
    periods[~np.isfinite(kept[-1]).all(axis=1)] = -1
    return periods
