"""Maps from one stride to the next: their derivatives by differences, and their modes.

A map here is any function of many rows at once, `(n, d) -> (n, d)`; a row that has no image is NaN.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from glassgait.models.arrays import Array

Map = Callable[[Array, NDArray[np.int64]], Array]
"""Maps points (n, d), each of the problem (n,) whose number is given, to their images (n, d)."""

N_GROUPS = 10
"""Groups of differences that an averaged Jacobian's error is estimated from."""


@dataclass(frozen=True)
class Modes:
    """How small differences from a fixed point go on.

    Attributes:
        eigenvalues: Factors per stride (d,; complex), the greatest first.
        left: Left eigenvector of the slowest mode (d,; complex): `left @ difference` is the mode's
            amplitude, which one stride multiplies by the eigenvalue.
        right: Its right eigenvector (d,; complex): what the mode looks like.
    """

    eigenvalues: NDArray[np.complex128]
    left: NDArray[np.complex128]
    right: NDArray[np.complex128]

    @property
    def radius(self) -> float:
        """The spectral radius: the slowest mode's factor per stride."""
        return float(np.abs(self.eigenvalues[0]))

    @property
    def participation(self) -> Array:
        """How much each coordinate takes part in the slowest mode: shares (d,) of 1.

        These are participation factors (Pérez-Arriaga et al., 1982): the product of what a
        coordinate excites of the mode and what it shows of it. They do not change with its unit.
        """
        factors = np.abs(self.left * self.right)
        return np.asarray(factors / factors.sum(), dtype=np.float64)


def modes_of(jacobian: Array) -> Modes:
    """Takes a finite Jacobian (d, d) apart.

    Raises:
        ValueError: if it is not finite.
    """
    eigenvalues, left, right = linalg.eig(jacobian, left=True, right=True)  # type: ignore[misc]
    order = np.argsort(-np.abs(eigenvalues), kind="stable")
    slowest = order[0]
    return Modes(
        eigenvalues=eigenvalues[order].astype(complex),
        left=left[:, slowest].conj().astype(complex),
        right=right[:, slowest].astype(complex),
    )


def jacobians(step: Map, points: Array, size: float) -> Array:
    """Differentiates a map by central differences, in one call with two rows a coordinate.

    Args:
        step: The map.
        points: Where (m, d), a point a problem.
        size: How far each coordinate is moved either way.

    Returns:
        Jacobians (m, d, d), column by column; NaN where a row has no image.
    """
    n_points, n = points.shape
    moves = size * np.concatenate([np.eye(n), -np.eye(n)])
    rows = (points[:, None] + moves).reshape(-1, n)
    images = step(rows, np.repeat(np.arange(n_points), 2 * n)).reshape(n_points, 2, n, n)
    return np.swapaxes(images[:, 0] - images[:, 1], 1, 2) / (2.0 * size)


def averaged_jacobians(
    step: Map, points: Array, *, size: float, n_pairs: int, generator: np.random.Generator
) -> tuple[Array, Array]:
    """Fits the linear map that best predicts where differences of a finite size go.

    Where a map jumps, as that of a policy of trees does everywhere, it has no useful derivative;
    this is what differences of that size meet on average.

    Args:
        step: The map.
        points: Where (m, d), a point a problem.
        size: Standard deviation of each coordinate's difference.
        n_pairs: Differences, each taken either way.
        generator: Source of the differences, which are those of all points.

    Returns:
        The Jacobians (m, d, d), and those of `N_GROUPS` fits (m, N_GROUPS, d, d) that leave a group
        of differences out each, for the jackknife. Pairs without an image are left out.
    """
    n_points, n = points.shape
    moves = size * generator.normal(size=(n_pairs, n))
    rows = (points[:, None] + np.concatenate([moves, -moves])).reshape(-1, n)
    images = step(rows, np.repeat(np.arange(n_points), 2 * n_pairs))
    images = images.reshape(n_points, 2, n_pairs, n)
    change = 0.5 * (images[:, 0] - images[:, 1])
    group = np.arange(n_pairs) % N_GROUPS

    def fitted(own: Array, kept: NDArray[np.bool_]) -> Array:
        kept = kept & np.isfinite(own).all(axis=1)
        return np.asarray(np.linalg.lstsq(moves[kept], own[kept])[0].T, dtype=np.float64)

    whole = [fitted(own, group >= 0) for own in change]
    parts = [[fitted(own, group != out) for out in range(N_GROUPS)] for own in change]
    return np.array(whole), np.array(parts)


def jackknife_error(parts: Array) -> Array:
    """Returns the standard error (m,) from values that leave a group out each (m, n_groups)."""
    n = parts.shape[1]
    return np.sqrt((n - 1) / n * np.square(parts - parts.mean(axis=1, keepdims=True)).sum(axis=1))


def newton(
    step: Map, points: Array, *, size: float, tolerance: float, n_iterations: int, reach: float
) -> tuple[Array, Array]:
    """Looks for fixed points near given ones, whether a map goes to them or away from them.

    Args:
        step: The map.
        points: Where to begin (m, d), a point a problem.
        size: How far coordinates are moved for derivatives.
        tolerance: Residual at which a point is fixed: the greatest change of any coordinate.
        n_iterations: Newton steps at most.
        reach: Greatest change of any coordinate in a step; a longer step is shortened.

    Returns:
        The points with the least residuals that were met (m, d), and these (m,); infinite where a
        point has no image.
    """
    best, residuals = points.copy(), np.full(len(points), np.inf)
    now, open_ones = points.copy(), np.arange(len(points))
    for iteration in range(n_iterations + 1):
        change = step(now[open_ones], open_ones) - now[open_ones]
        size_of = np.nan_to_num(np.abs(change).max(axis=1), nan=np.inf)
        better = size_of < residuals[open_ones]
        best[open_ones[better]] = now[open_ones[better]]
        residuals[open_ones[better]] = size_of[better]
        going = (size_of > tolerance) & np.isfinite(size_of)
        open_ones, change = open_ones[going], change[going]
        if len(open_ones) == 0 or iteration == n_iterations:
            break
        own = jacobians(lambda x, i, k=open_ones: step(x, k[i]), now[open_ones], size)
        sound = np.isfinite(own).all(axis=(1, 2))
        open_ones, change, own = open_ones[sound], change[sound], own[sound]
        move = np.linalg.solve(np.eye(points.shape[1]) - own, change[..., None])[..., 0]
        longest = np.abs(move).max(axis=1, keepdims=True, initial=0.0)
        now[open_ones] += move * np.minimum(1.0, reach / np.maximum(longest, 1e-300))
    return best, residuals


def growth(step: Map, points: Array, *, size: float, n_strides: int, n_left_out: int) -> Array:
    """Measures how a tiny difference grows along the orbits of points, whatever they are.

    It is kept tiny by shortening it after each stride (Benettin et al., 1980). About a fixed point
    that attracts, this is the spectral radius; along a wandering orbit, the exponential of the
    largest Lyapunov exponent.

    Args:
        step: The map.
        points: Where the orbits begin (m, d), a point a problem.
        size: Length of the difference.
        n_strides: Strides.
        n_left_out: The first ones, in which the difference finds its direction.

    Returns:
        The geometric mean of the factor per stride (m,); NaN where an orbit ends.
    """
    n_points, n = points.shape
    direction = np.full((n_points, n), 1.0 / np.sqrt(n))
    places = np.tile(np.arange(n_points), 2)
    logs = []
    for _ in range(n_strides):
        images = step(np.concatenate([points, points + size * direction]), places)
        points, moved = np.split(images, 2)
        length = np.linalg.norm(moved - points, axis=1, keepdims=True)
        with np.errstate(divide="ignore", invalid="ignore"):
            logs.append(np.log(length[:, 0] / size))
            # A difference that is gone is given its old direction again.
            direction = np.where(length == 0.0, direction, (moved - points) / length)
    return np.exp(np.mean(logs[n_left_out:], axis=0))
