"""Specifications of the arrays of policies, and the precision of their files."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glassgait.models.errors import InputError, shown

LARGEST = 1e30
"""Greatest size of a parameter: products of a few, as in a network, stay finite."""

MAX_ENTRIES = 2**26
"""Greatest number of entries of an array: half a gigabyte of double precision."""


@dataclass(frozen=True)
class Reals:
    """An array of half, single or double precision, converted to double precision.

    Attributes:
        dims: Its dimensions: numbers, or names that stand for the same size in all arrays of a
            policy, such as "joints trees nodes+1". A question mark allows a size of 0.
        least: Least value.
        most: Greatest value; inf allows infinity itself.
        ascending: Whether the last axis must not descend.
    """

    dims: str
    least: float = -LARGEST
    most: float = LARGEST
    ascending: bool = False

    def taken(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        """Returns the array in double precision, if its numbers are valid."""
        if array.dtype not in (np.float16, np.float32, np.float64):
            raise InputError(f"is of type {array.dtype}; it must be float16, float32 or float64")
        with np.errstate(invalid="ignore"):
            values = array.astype(np.float64, copy=False)
            inside = (values >= self.least) & (values <= self.most)
        if not inside.all():
            raise InputError(
                f"holds {values[~inside][0]:g}; its numbers must be from {self.least:g} to "
                f"{self.most:g}"
            )
        if self.ascending and not np.all(values[..., 1:] >= values[..., :-1]):
            raise InputError("does not ascend; it must along its last axis")
        return values


@dataclass(frozen=True)
class Indices:
    """An array of indices.

    Attributes:
        dims: Its dimensions, as those of `Reals`.
        of: Name of the size that they must stay below.
    """

    dims: str
    of: str

    def taken(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        """Returns the array, if its numbers are valid."""
        if array.dtype.kind not in "iu" or not np.can_cast(array.dtype, np.int64):
            raise InputError(f"is of type {array.dtype}; it must be uint8, uint16, int32 or int64")
        inside = (array >= 0) & (array < sizes[self.of])
        if not inside.all():
            last = sizes[self.of] - 1
            raise InputError(f"holds {array[~inside][0]}; its numbers must be from 0 to {last}")
        return array


ArraySpec = Reals | Indices


def take_arrays(
    arrays: Mapping[str, NDArray[Any]], specs: Mapping[str, ArraySpec], sizes: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """Checks the arrays of a policy, and returns them as it computes with them.

    Args:
        arrays: The arrays, by name.
        specs: What each must be.
        sizes: Sizes that are known, such as "joints" and "observations".

    Raises:
        InputError: if an array is missing, left over, or not valid; the message names it.
    """
    for name in sorted(set(arrays) ^ set(specs)):
        if name in specs:
            raise InputError(f"lacks the array {name!r}; make it anew")
        raise InputError(f"holds an array {shown(name)}, which is no part of it; make it anew")
    known, taken = dict(sizes), {}
    for name, spec in specs.items():
        try:
            _fit_shape(np.shape(arrays[name]), spec.dims, known)
            taken[name] = spec.taken(np.asarray(arrays[name]), known)
        except InputError as error:
            raise InputError(f"array {name!r} {error}; make it anew") from None
    return taken


def _fit_shape(shape: tuple[int, ...], dims: str, sizes: dict[str, int]) -> None:
    """Refuses a shape that does not have these dimensions, and notes sizes that were unknown."""
    fits = len(shape) == len(dims.split())
    for size, dim in zip(shape, dims.split(), strict=False):
        name, _, extra = dim.rstrip("?").partition("+")
        base, least = size - int(extra or 0), 0 if dim.endswith("?") else 1
        known = int(name) if name.isdigit() else sizes.setdefault(name, max(base, least))
        fits = fits and base == known
    if not fits or np.prod(shape, dtype=float) > MAX_ENTRIES:
        known = ", ".join(f"{size} {name}" for name, size in sizes.items())
        raise InputError(
            f"is of shape {shown(shape)}; it must be ({', '.join(dims.split())}), with {known} and "
            f"at most {MAX_ENTRIES} entries"
        )


_NARROW = {"i": (np.uint8, np.int32), "f": (np.float16, np.float32)}
"""Narrower types of whole numbers and of doubles, the narrowest first."""


def narrowest(array: NDArray[Any]) -> NDArray[Any]:
    """Returns an array in the narrowest type that holds all its values exactly."""
    for width in _NARROW.get(array.dtype.kind, ()):
        if np.array_equal(rounded(array, width), array, equal_nan=True):
            return array.astype(width)
    return array


def rounded(array: NDArray[Any], width: DTypeLike) -> NDArray[Any]:
    """Returns an array of the same type, with its values rounded to a narrower one."""
    with np.errstate(over="ignore"):
        return array.astype(width).astype(array.dtype)
