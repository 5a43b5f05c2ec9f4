"""What a policy's arrays must be, and how many digits their files hold."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown

LARGEST = 1e30
"""Greatest size of a parameter: products of a few, as in a network, stay finite."""

MAX_ENTRIES = 2**26
"""Greatest number of entries of an array: half a gigabyte of double precision."""


@dataclass(frozen=True)
class Reals:
    """An array of half, single or double precision, taken over in double precision.

    Attributes:
        dims: Its dimensions: numbers, or names that stand for the same size in all arrays of a
            policy, such as "joints trees nodes+1". A size that is not known before is 1 or more,
            or 0 or more after a question mark.
        least: Least value.
        most: Greatest value; inf lets in infinity itself.
        ascending: Whether no entry of the last axis is below the one before it.
    """

    dims: str
    least: float = -LARGEST
    most: float = LARGEST
    ascending: bool = False

    def taken(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[np.float64]:
        """Returns the array in double precision.

        Raises:
            InputError: if its numbers are of another kind or out of range.
        """
        if array.dtype not in (np.float16, np.float32, np.float64):
            raise InputError(f"is of type {array.dtype}; it must be float16, float32 or float64")
        with np.errstate(invalid="ignore"):
            values = array.astype(np.float64, copy=False)
            inside = (values >= self.least) & (values <= self.most)
        if not inside.all():
            end = "infinity" if self.most == np.inf else f"{self.most:g}"
            raise InputError(
                f"holds {values[~inside][0]:g}; its numbers must be from {self.least:g} to {end}"
            )
        if self.ascending and not np.all(values[..., 1:] >= values[..., :-1]):
            raise InputError("does not ascend; it must along its last axis")
        return values


@dataclass(frozen=True)
class Indices:
    """An array of whole numbers that point at something.

    Attributes:
        dims: Its dimensions, as those of `Reals`.
        of: Name of the size of what they point at.
    """

    dims: str
    of: str

    def taken(self, array: NDArray[Any], sizes: Mapping[str, int]) -> NDArray[Any]:
        """Returns the array as it is.

        Raises:
            InputError: if its numbers are of another kind or point at nothing.
        """
        if array.dtype.kind not in "iu" or not np.can_cast(array.dtype, np.int64):
            raise InputError(f"is of type {array.dtype}; it must be uint8, uint16, int32 or int64")
        inside = (array >= 0) & (array < sizes[self.of])
        if not inside.all():
            last = sizes[self.of] - 1
            raise InputError(f"holds {array[~inside][0]}; its numbers must be from 0 to {last}")
        return array


ArraySpec = Reals | Indices


def refuse_other_arrays(arrays: Iterable[str], specs: Mapping[str, ArraySpec]) -> None:
    """Refuses arrays that lack one or hold one more.

    Raises:
        InputError: if they do; the message names the array.
    """
    names = set(arrays)
    for name in specs:
        if name not in names:
            raise InputError(f"lacks the array {name!r}; make it anew")
    for name in sorted(names - set(specs)):
        raise InputError(f"holds an array {shown(name)}, which is no part of it; make it anew")


def take_arrays(
    arrays: Mapping[str, NDArray[Any]], specs: Mapping[str, ArraySpec], sizes: Mapping[str, int]
) -> dict[str, NDArray[Any]]:
    """Checks the arrays of a policy and returns them as it computes with them.

    Args:
        specs: What each must be.
        sizes: Sizes that are known, such as "joints" and "observations".

    Raises:
        InputError: if an array is missing, left over, or not what it must be; the message names it.
    """
    refuse_other_arrays(arrays, specs)
    known = dict(sizes)
    taken = {}
    for name, spec in specs.items():
        try:
            _fit_shape(np.shape(arrays[name]), spec, known)
            taken[name] = spec.taken(np.asarray(arrays[name]), known)
        except InputError as error:
            raise InputError(f"array {name!r} {error}; make it anew") from None
    return taken


def _fit_shape(shape: tuple[int, ...], spec: ArraySpec, sizes: dict[str, int]) -> None:
    """Refuses another shape, and notes the sizes that this one has."""
    dims = [_parsed(dim) for dim in spec.dims.split()]
    if len(shape) == len(dims):
        for size, (name, extra, least) in zip(shape, dims, strict=True):
            if name and size - extra >= least:
                sizes.setdefault(name, size - extra)
    if shape != tuple(sizes.get(name, -1) + extra if name else extra for name, extra, _ in dims):
        wanted = ", ".join(_size_text(name, extra, sizes) for name, extra, _ in dims)
        raise InputError(f"is of shape {shown(shape)}; it must be ({wanted})")
    if np.prod(shape, dtype=float) > MAX_ENTRIES:
        raise InputError(f"is of shape {shown(shape)}; it must have at most {MAX_ENTRIES} entries")


def _parsed(dim: str) -> tuple[str, int, int]:
    """Splits a dimension into its name, what is added to it, and the least size of that name."""
    if dim.isdigit():
        return "", int(dim), 0
    name, _, extra = dim.rstrip("?").partition("+")
    return name, int(extra or 0), 0 if dim.endswith("?") else 1


def _size_text(name: str, extra: int, sizes: Mapping[str, int]) -> str:
    if not name or name in sizes:
        return str(sizes.get(name, 0) + extra)
    return f"{name} + {extra}" if extra else name


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
