"""The number types of a policy's arrays: wide to compute with, narrow in files."""

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

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
