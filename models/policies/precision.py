"""The number types of a policy's arrays: wide to compute with, narrow in files and libraries."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glassgait.models.arrays import Array

_NARROW = {"i": (np.uint8, np.int32), "f": (np.float16, np.float32)}
"""Narrower types of whole numbers and of doubles, the narrowest first."""


def narrowest(array: NDArray[Any]) -> NDArray[Any]:
    """Returns an array in the narrowest type that holds all its values exactly.

    Args:
        array: Numbers, any shape.
    """
    for width in _NARROW.get(array.dtype.kind, ()):
        if np.array_equal(rounded(array, width), array, equal_nan=True):
            return array.astype(width)
    return array


def rounded(array: NDArray[Any], width: DTypeLike) -> NDArray[Any]:
    """Returns an array, any shape, of the same type but rounded to what a narrower one can hold."""
    with np.errstate(over="ignore"):
        return array.astype(width).astype(array.dtype)


def single_precision_cuts(thresholds: NDArray[np.floating]) -> Array:
    """Returns cuts that part doubles as the thresholds part them once rounded to single precision.

    scikit-learn's exact trees round an observation before they compare it. With these cuts the
    branches are the same without rounding.

    Args:
        thresholds: Thresholds, any shape.

    Returns:
        Cuts c of the same shape: `x <= c` if and only if `float32(x) <= threshold`.
    """
    below = _single_precision_below(thresholds)
    above = np.nextafter(below, np.float32(np.inf))
    middle = 0.5 * (below.astype(float) + above.astype(float))
    # Halfway, rounding goes to the neighbour whose last bit is 0.
    goes_down = middle.astype(np.float32) == below
    return np.where(goes_down, middle, np.nextafter(middle, -np.inf))


def lower_neighbours(cuts: Array) -> NDArray[np.float32] | None:
    """Returns the thresholds, in single precision, of which these are the cuts, if there are such.

    Args:
        cuts: Cuts of any shape, of any source.
    """
    below = _single_precision_below(cuts)
    return below if np.array_equal(single_precision_cuts(below), cuts) else None


def _single_precision_below(values: NDArray[Any]) -> NDArray[np.float32]:
    """Returns the greatest numbers of single precision that are at most as large."""
    with np.errstate(over="ignore"):
        near = values.astype(np.float32)
    return np.where(near > values, np.nextafter(near, np.float32(-np.inf)), near)
