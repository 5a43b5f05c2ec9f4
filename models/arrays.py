"""Arrays of numbers."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Scalar = TypeVar("Scalar", bound=np.generic)


def clip(values: Array, least: Array | float, greatest: Array | float) -> Array:
    """Returns the nearest values in ranges, as `np.clip` does; that takes longer for one robot."""
    return np.minimum(np.maximum(values, least), greatest)


def map_arrays(change: Callable[..., Any], *trees: Any) -> Any:
    """Changes every array of nested tuples, together with those of others of the same shape.

    `change` returns the new array for the arrays at one place; None stays None.
    """
    first = trees[0]
    if first is None:
        return None
    if not isinstance(first, tuple):
        return change(*trees)
    parts = [map_arrays(change, *values) for values in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)


def stacked(*components: NDArray[Scalar]) -> NDArray[Scalar]:
    """Returns arrays (...) side by side (..., k); for few robots `np.stack` is slower."""
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
