"""Arrays of numbers."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def clip(values: Array, least: Array | float, greatest: Array | float) -> Array:
    """Returns the nearest values in ranges, as `np.clip` does; that takes longer for one robot."""
    return np.minimum(np.maximum(values, least), greatest)


def map_arrays(change: Callable[..., Any], *trees: Any) -> Any:
    """Changes every array of nested tuples, together with those of others of the same shape.

    Args:
        change: Returns the new array for the arrays at one place.
        trees: Arrays, or tuples of such; None stays None.
    """
    first = trees[0]
    if first is None:
        return None
    if not isinstance(first, tuple):
        return change(*trees)
    parts = [map_arrays(change, *values) for values in zip(*trees, strict=True)]
    return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
