"""The greatest sum of tables of one and of two labels, exactly, by eliminating label after label.

Values that another one beats, whatever the other labels are, are left out first: most are. What an
eliminated label leaves behind is a table of the labels that it met. Labels are eliminated in an
order that keeps these tables small; where one would still be large, a label is tried value by value
instead.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array

LARGEST = 2**23
"""Greatest number of entries of a table."""

Table = tuple[tuple[int, ...], Array]
"""Labels that a table is of, and its values, an axis a label."""


def greatest_sum(
    unary: Sequence[Array], pairs: Iterable[tuple[int, int, Array]]
) -> tuple[float, NDArray[np.intp]]:
    """Finds labels whose sum of tables is greatest.

    Args:
        unary: Values of each label (n arrays); -inf where a label cannot be chosen.
        pairs: Two labels, and the table of both.

    Returns:
        The greatest sum, and the label of each (n).
    """
    pairs = list(pairs)
    kept = _unbeaten(unary, pairs)
    tables: list[Table] = [((i,), own[kept[i]]) for i, own in enumerate(unary)]
    tables += [((a, b), table[np.ix_(kept[a], kept[b])]) for a, b, table in pairs]
    value, chosen = _solve(tables, [len(own) for own in kept])
    labels = [own[chosen[i]] for i, own in enumerate(kept)]
    return value, np.array(labels, dtype=np.intp)


def _unbeaten(
    unary: Sequence[Array], pairs: Iterable[tuple[int, int, Array]]
) -> list[NDArray[np.intp]]:
    """Lists the values of each label that no other value beats, whatever the other labels are.

    This is the elimination of dead ends with the criterion of R. F. Goldstein, *Efficient rotamer
    elimination applied to protein side-chains and related spin glasses*, Biophysical Journal 66
    (1994).
    """
    kept = [np.flatnonzero(own > -np.inf) for own in unary]
    met: list[list[tuple[int, Array]]] = [[] for _ in unary]
    for one, two, table in pairs:
        met[one].append((two, table))
        met[two].append((one, table.T))
    left = set(range(len(unary)))
    while left:
        label = left.pop()
        own = unary[label][kept[label]]
        # What changing from the row's value to the column's gains at least.
        gain = own[None, :] - own[:, None]
        for other, table in met[label]:
            values = table[np.ix_(kept[label], kept[other])]
            gain = gain + (values[None, :] - values[:, None]).min(axis=-1)
        np.fill_diagonal(gain, -np.inf)
        best = np.ones(len(own), dtype=bool)
        for value, gains in enumerate(gain):
            # Of two that are equally good one stays.
            best[value] = not (gains[best] >= 0.0).any()
        if not best.all():
            kept[label] = kept[label][best]
            left.update(other for other, _ in met[label])
    return kept


def _solve(tables: list[Table], sizes: Sequence[int]) -> tuple[float, dict[int, int]]:
    constant, steps = 0.0, []
    left = set(range(len(sizes)))
    while left:
        label = min(left, key=lambda own: (_cost(own, tables, sizes), own))
        if _cost(label, tables, sizes) > LARGEST:
            value, chosen = _tried(tables, sizes)
            break
        left.discard(label)
        met = [table for table in tables if label in table[0]]
        tables = [table for table in tables if label not in table[0]]
        axes, whole = _summed(met, label)
        steps.append((label, axes, np.argmax(whole, axis=0)))
        if axes:
            tables.append((axes, whole.max(axis=0)))
        else:
            constant += float(whole.max())
    else:
        value, chosen = 0.0, {}
    for label, axes, best in reversed(steps):
        chosen[label] = int(best[tuple(chosen[axis] for axis in axes)])
    return constant + value, chosen


def _tried(tables: list[Table], sizes: Sequence[int]) -> tuple[float, dict[int, int]]:
    """Tries each value of the label that meets most others."""
    labels = {label for axes, _ in tables for label in axes}
    most = max(labels, key=lambda own: (sum(own in axes for axes, _ in tables), -own))
    best, chosen = -np.inf, {}
    for value in range(sizes[most]):
        cut = [_cut(table, most, value) for table in tables]
        constant = sum(float(own) for axes, own in cut if not axes)
        found, others = _solve_left([table for table in cut if table[0]], sizes)
        if constant + found > best:
            best, chosen = constant + found, {**others, most: value}
    return best, chosen


def _solve_left(tables: list[Table], sizes: Sequence[int]) -> tuple[float, dict[int, int]]:
    """Solves for the labels that tables are of."""
    labels = sorted({label for axes, _ in tables for label in axes})
    places = {label: place for place, label in enumerate(labels)}
    renamed = [(tuple(places[axis] for axis in axes), values) for axes, values in tables]
    value, chosen = _solve(renamed, [sizes[label] for label in labels])
    return value, {labels[place]: own for place, own in chosen.items()}


def _cut(table: Table, label: int, value: int) -> Table:
    axes, values = table
    if label not in axes:
        return table
    left = np.asarray(values.take(value, axes.index(label)))
    return tuple(axis for axis in axes if axis != label), left


def _cost(label: int, tables: Sequence[Table], sizes: Sequence[int]) -> int:
    met = {other for axes, _ in tables if label in axes for other in axes}
    return int(np.prod([sizes[other] for other in met], dtype=float))


def _summed(tables: Sequence[Table], label: int) -> tuple[tuple[int, ...], Array]:
    """Adds tables, the label's axis first; returns the other labels and the sum."""
    others = sorted({axis for axes, _ in tables for axis in axes} - {label})
    order = [label, *others]
    whole: Array | float = 0.0
    for axes, values in tables:
        places = [order.index(axis) for axis in axes]
        shape = [1] * len(order)
        for place, size in zip(places, values.shape, strict=True):
            shape[place] = size
        whole = whole + values.transpose(np.argsort(places)).reshape(shape)
    return tuple(others), np.asarray(whole)
