"""The shortest step that gains enough along slopes, within limits: a projection onto a box."""

import numpy as np

from glassgait.models.arrays import Array

_HALVINGS = 45
"""Halvings of the multiplier's interval, down to rounding errors."""


def shortest_steps(gain: Array, need: Array, least: Array, most: Array) -> tuple[Array, Array]:
    """Minimizes Σ w² where Σ gain · w is `need` or more, and every w within its limits.

    Every w is least ≤ multiplier · gain ≤ most, cut at its limits; one multiplier serves a row.

    Args:
        gain: What a unit of each step gains (m, n), 0 or more.
        need: What must be gained (m).
        least: Least steps (m, n), 0 or more.
        most: Greatest steps (m, n).

    Returns:
        The steps (m, n), and a bound (m) that the minimum is not below: the minimum itself but for
        rounding errors, infinite where the limits allow no such steps.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(gain > 0, most / gain, 0.0)
    low, high = np.zeros(len(need)), needed.max(axis=1, initial=0.0)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        enough = _total(gain, _cut(middle, gain, least, most)) >= need
        high, low = np.where(enough, middle, high), np.where(enough, low, middle)
    steps = _cut(high, gain, least, most)
    missing = need - _total(gain, steps)
    # Any multiplier bounds the minimum from below, by Lagrange's dual.
    bound = (steps * steps).sum(axis=1) + 2.0 * high * missing
    possible = missing <= 1e-12 * (1.0 + np.abs(need))
    return steps, np.where(possible, bound, np.inf)


def _cut(multiplier: Array, gain: Array, least: Array, most: Array) -> Array:
    return np.clip(multiplier[:, None] * gain, least, most)


def _total(gain: Array, steps: Array) -> Array:
    return np.einsum("ij,ij->i", gain, steps)
