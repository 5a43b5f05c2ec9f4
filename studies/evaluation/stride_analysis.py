"""Where a gait settles: a periodic orbit, one of several strides, or none; and its fixed point."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.stride_map import (
    Map,
    Modes,
    averaged_jacobians,
    growth,
    jackknife_error,
    jacobians,
    modes_of,
    newton,
)
from glassgait.studies.common.loop_state import ODOMETRY_NAMES
from glassgait.studies.evaluation.strides import SPEEDS, StrideMap

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


PUSHES = (0.002, 0.01, 0.05)
"""Speeds of the pushes whose decay is compared with the slowest mode (m/s)."""

N_DECAY = 10
"""Strides over which a push's decay is fitted."""

GONE = 1e-4
"""Share of a push's first amplitude below which nothing is read off: fixed points are not exact."""

GROWTH_STEP, N_GROWTH, N_GROWTH_LEFT_OUT = 1e-3, 50, 10
"""Of the growth along an orbit: the difference's size (units), strides, and those left out."""

AVERAGED_STEP, N_PAIRS = 0.2, 180
"""Of the averaged Jacobian: the differences' standard deviation (units), 0.01 rad of a joint as the
sensors' noise is, and how many there are."""

CALLED = {
    "height": "height",
    "roll": "roll",
    "pitch": "pitch",
    "roll rate": "roll",
    "pitch rate": "pitch",
    "yaw rate": "yaw",
    "forward speed": "forward speed",
    "lateral speed": "lateral speed",
    "vertical speed": "height",
    **dict.fromkeys(ODOMETRY_NAMES, "odometry"),
}
"""What coordinates are called in a mode, those of the trunk and of odometry; others are a leg's."""


def analyse(
    strides: StrideMap, *, n_strides: int, step_sizes: tuple[float, ...], seed: int
) -> list[Any]:
    """Analyses the gait of every command.

    Args:
        strides: The stride map.
        n_strides: Strides that an orbit has to settle.
        step_sizes: Sizes of the differences by which the map is differentiated (units).
        seed: Seed of the averaged Jacobian's differences.

    Returns:
        A record a command: the command, where its orbit goes, how a tiny difference grows along it,
        the averaged Jacobian's spectral radius and error, and for a fixed point its spectral
        radius by step size, eigenvalues, parts of the slowest mode, and decays.
    """
    orbits = find_orbits(
        strides,
        strides.first_points(),
        n_strides=n_strides,
        differentiable=not strides.is_stepwise,
    )
    command = strides.command
    records: list[Any] = [
        {
            "speed": float(command.velocity[i, 0]),
            "yaw_rate": float(command.velocity[i, 1]),
            "dwell": int(command.dwell[i]),
            "period": int(orbits.periods[i]),
            "sway": float(orbits.sway[i]),
            "residual": float(orbits.residuals[i]),
            "fixed": bool(np.isfinite(orbits.fixed[i]).all()),
        }
        for i in range(len(command.dwell))
    ]
    alive = np.flatnonzero(orbits.periods >= 0)
    if len(alive):
        _add_rates(records, strides, orbits, alive, np.random.default_rng(seed))
    there = np.array([i for i in alive if records[i]["fixed"]], dtype=np.int64)
    if len(there):
        _add_modes(records, strides, orbits.fixed, there, step_sizes)
    return records


def _add_rates(
    records: list[Any],
    strides: StrideMap,
    orbits: Orbits,
    alive: NDArray[np.int64],
    generator: np.random.Generator,
) -> None:
    """Measures the orbits of the commands `alive`, whether they are periodic or not."""

    def step(points: Array, problems: NDArray[np.int64]) -> Array:
        return strides(points, alive[problems])

    rates = growth(
        step,
        orbits.last[alive],
        size=GROWTH_STEP,
        n_strides=N_GROWTH,
        n_left_out=N_GROWTH_LEFT_OUT,
    )
    whole, parts = averaged_jacobians(
        step, orbits.mean[alive], size=AVERAGED_STEP, n_pairs=N_PAIRS, generator=generator
    )
    radii = np.abs(np.linalg.eigvals(parts)).max(axis=-1)
    for i, rate, own, error in zip(alive, rates, whole, jackknife_error(radii), strict=True):
        modes = modes_of(own)
        records[i] |= {
            "growth": float(rate),
            "averaged_radius": modes.radius,
            "averaged_error": float(error),
            "averaged_parts": parts_of(modes, strides.names),
        }


def _add_modes(
    records: list[Any],
    strides: StrideMap,
    fixed: Array,
    there: NDArray[np.int64],
    step_sizes: tuple[float, ...],
) -> None:
    """Differentiates the map at the fixed points of the commands `there`."""
    usual = strides.stride(fixed[there], there).n_steps
    counts: list[NDArray[np.int64]] = []

    def noted(points: Array, problems: NDArray[np.int64]) -> Array:
        done = strides.stride(points, there[problems])
        counts.append(done.n_steps.reshape(len(there), -1))
        return done.images

    all_modes = [_modes(jacobians(noted, fixed[there], size)) for size in step_sizes]
    rows = np.concatenate(counts, axis=1)
    modes = [_nearest(own) for own in zip(*all_modes, strict=True)]
    decays = _decays(strides, fixed, there, modes)
    for k, i in enumerate(there):
        records[i] |= {
            "n_steps": int(usual[k]),
            "rows": rows.shape[1],
            "other_steps": int(np.sum((rows[k] != usual[k]) & (rows[k] > 0))),
            "lost": int(np.sum(rows[k] == 0)),
            "radii": [_radius(own[k]) for own in all_modes],
        }
        mode = modes[k]
        if mode is not None:
            records[i] |= {
                "radius": mode.radius,
                "eigenvalues": [[value.real, value.imag] for value in mode.eigenvalues[:12]],
                "parts": parts_of(mode, strides.names),
                "decays": decays[k],
            }


def _modes(own: Array) -> list[Modes | None]:
    return [modes_of(one) if np.isfinite(one).all() else None for one in own]


def _radius(modes: Modes | None) -> float:
    return modes.radius if modes else float("nan")


def _nearest(own: tuple[Modes | None, ...]) -> Modes | None:
    """Returns the modes of the step size whose radius is nearest to all others': the median."""
    there = sorted((modes for modes in own if modes), key=lambda modes: modes.radius)
    return there[(len(there) - 1) // 2] if there else None


def parts_of(modes: Modes, names: Sequence[str]) -> dict[str, float]:
    """Sums up what takes part in the slowest mode: motions of the trunk, legs, and odometry.

    Args:
        modes: The modes.
        names: What the coordinates are.

    Returns:
        Shares of 1, the greatest first. A leg's are those of its joints, their rates and its
        previous actions.
    """
    parts: dict[str, float] = {}
    for name, share in zip(names, modes.participation, strict=True):
        called = CALLED.get(name) or f"leg {next(leg for leg in quadruped.LEGS if leg in name)}"
        parts[called] = parts.get(called, 0.0) + float(share)
    return dict(sorted(parts.items(), key=lambda part: -part[1]))


def _decays(
    strides: StrideMap, fixed: Array, there: NDArray[np.int64], modes: list[Modes | None]
) -> list[list[float]]:
    """Pushes trunks forward, back, left and right, and measures how the slowest mode goes on.

    Returns:
        For each fixed point, for each of `PUSHES`, the median over directions of the factor per
        stride; NaN where nothing could be read off.
    """
    moves = np.zeros((len(PUSHES), 4, len(strides.names)))
    for i, speed in enumerate(PUSHES):
        moves[i, :, SPEEDS] = speed * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    moves = moves.reshape(-1, len(strides.names)) / strides.units
    points = (fixed[there][:, None] + moves).reshape(-1, len(strides.names))
    problems = np.repeat(there, len(moves))
    orbit = [points]
    for _ in range(N_DECAY):
        orbit.append(strides(orbit[-1], problems))
    away = np.array(orbit).reshape(N_DECAY + 1, len(there), len(moves), -1) - fixed[there][:, None]
    factors = []
    for k, mode in enumerate(modes):
        left = np.full(len(strides.names), np.nan) if mode is None else mode.left
        amplitudes = np.abs(away[:, k] @ left)
        each = np.array([_factor(amplitudes[:, j]) for j in range(len(moves))])
        factors.append(np.median(each.reshape(len(PUSHES), -1), axis=1).tolist())
    return factors


def _factor(amplitudes: Array) -> float:
    """Fits the factor per stride to a mode's amplitudes (n + 1,)."""
    small = np.flatnonzero(~(amplitudes > GONE * amplitudes[0]))
    stop = small[0] if len(small) else len(amplitudes)
    if stop < 3:
        return float("nan")
    return float(np.exp(np.polyfit(np.arange(stop), np.log(amplitudes[:stop]), 1)[0]))
