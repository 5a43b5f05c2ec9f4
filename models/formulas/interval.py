"""Interval arithmetic on arrays, rounded outward so that results contain all possible values."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array

LIBRARY_ULPS = 4
"""Assumed error of NumPy's sin, cos and tanh, in units in the last place; the documented errors
of the libraries behind them are below 1."""

LARGEST_ANGLE = 1e6  # beyond this angle (rad), a sine is only bounded by -1 and 1


@dataclass(frozen=True)
class Interval:
    """Elementwise intervals, from arrays of least and greatest values of the same shape."""

    lower: Array
    upper: Array

    @classmethod
    def point(cls, value: float, shape: tuple[int, ...]) -> "Interval":
        return cls(np.full(shape, value), np.full(shape, value))

    @property
    def magnitude(self) -> Array:
        return np.maximum(np.abs(self.lower), np.abs(self.upper))

    def __neg__(self) -> "Interval":
        return Interval(-self.upper, -self.lower)

    def __add__(self, other: "Interval") -> "Interval":
        return _outward(self.lower + other.lower, self.upper + other.upper)

    def __sub__(self, other: "Interval") -> "Interval":
        return self + -other

    def __mul__(self, other: "Interval") -> "Interval":
        with np.errstate(invalid="ignore"):
            products = np.stack(
                [a * b for a in (self.lower, self.upper) for b in (other.lower, other.upper)]
            )
        # Zero times an infinite end is zero, since all numbers of an interval are finite.
        products[np.isnan(products)] = 0.0
        return _outward(products.min(axis=0), products.max(axis=0))

    def power(self, exponent: int) -> "Interval":
        if exponent == 1:
            return self
        if exponent % 2:
            low, high = self.lower, self.upper
        else:
            straddles = (self.lower < 0.0) & (self.upper > 0.0)
            high = self.magnitude
            low = np.where(straddles, 0.0, np.minimum(np.abs(self.lower), np.abs(self.upper)))
        with np.errstate(over="ignore"):
            return _outward(low**exponent, high**exponent, ulps=exponent + LIBRARY_ULPS)

    def inverse(self) -> "Interval":
        """Returns 1 / self, which is unbounded if the interval contains 0."""
        has_zero = (self.lower <= 0.0) & (self.upper >= 0.0)
        with np.errstate(divide="ignore", over="ignore"):
            low, high = 1.0 / self.upper, 1.0 / self.lower
        bounds = _outward(low, high)
        lower = np.where(has_zero, -np.inf, bounds.lower)
        return Interval(lower, np.where(has_zero, np.inf, bounds.upper))

    def wave(self, wave: Callable[[Array], Array], crest: float) -> "Interval":
        """Bounds a wave from -1 to 1 with crests at (`crest` + 2 k)·π."""
        at_ends = np.stack([wave(self.lower), wave(self.upper)])
        ends = _outward(at_ends.min(axis=0), at_ends.max(axis=0), ulps=LIBRARY_ULPS)
        wide = self.magnitude > LARGEST_ANGLE
        high = np.where(wide | self._may_contain(crest), 1.0, np.minimum(ends.upper, 1.0))
        low = np.where(wide | self._may_contain(crest + 1.0), -1.0, np.maximum(ends.lower, -1.0))
        return Interval(low, high)

    def _may_contain(self, halves: float) -> NDArray[np.bool_]:
        """Returns where an interval may contain a number (halves + 2 k)·π, if in doubt True."""
        slack = 1e-9
        first = (self.lower / np.pi - halves) / 2.0 - slack
        last = (self.upper / np.pi - halves) / 2.0 + slack
        return np.floor(last) >= np.ceil(first)

    def tanh(self) -> "Interval":
        bounds = _outward(np.tanh(self.lower), np.tanh(self.upper), ulps=LIBRARY_ULPS)
        return Interval(np.maximum(bounds.lower, -1.0), np.minimum(bounds.upper, 1.0))


FUNCTIONS: dict[str, Callable[[Interval], Interval]] = {
    "sin": lambda x: x.wave(np.sin, crest=0.5),
    "cos": lambda x: x.wave(np.cos, crest=0.0),
    "tanh": Interval.tanh,
    "inverse": Interval.inverse,
}

OPERATORS: dict[str, Callable[..., Interval]] = {
    "add": Interval.__add__,
    "sub": Interval.__sub__,
    "mul": Interval.__mul__,
    "div": lambda dividend, divisor: dividend * divisor.inverse(),
    "neg": Interval.__neg__,
    "square": lambda x: x.power(2),
    "cube": lambda x: x.power(3),
    **FUNCTIONS,
}


def _outward(lower: Array, upper: Array, ulps: int = 1) -> Interval:
    for _ in range(ulps):
        lower, upper = np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf)
    return Interval(lower, upper)
