"""The array type, and functions that are faster than NumPy's for small arrays."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scalar = TypeVar("Scalar", bound=np.generic)


def clip(values: Array, least: Array | float, greatest: Array | float) -> Array:
    """Clips values to ranges; `np.clip` is slower for one robot."""
    return np.minimum(np.maximum(values, least), greatest)


def map_arrays(function: Callable[..., Any], *trees: Any) -> Any:
    """Applies a function to corresponding arrays of nested tuples; None stays None."""
    first = trees[0]
    if first is None:
        return None
    if not isinstance(first, tuple):
        return function(*trees)
    results = [map_arrays(function, *values) for values in zip(*trees, strict=True)]
    return type(first)(*results) if hasattr(first, "_fields") else tuple(results)


def stacked(*components: NDArray[Scalar]) -> NDArray[Scalar]:
    """Stacks k arrays (...) along a new last axis; `np.stack` is slower for few robots."""
    first = np.asarray(components[0])
    values = np.empty((*first.shape, len(components)), first.dtype)
    for i, component in enumerate(components):
        values[..., i] = component
    return values


def cross(a: Array, b: Array) -> Array:
    """Returns cross products (..., 3); for small arrays NumPy's function is slower."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return stacked(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
