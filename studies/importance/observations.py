"""Observations merged over legs, as the paper's table names them."""

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.task.observation import entries_of


def observation_groups(names: tuple[str, ...]) -> dict[str, NDArray[np.int64]]:
    """Groups observations that differ by leg alone: columns by merged name, in order."""
    merged = [entry.merged_name for entry in entries_of(names)]
    return {
        group: np.flatnonzero([name == group for name in merged]) for group in dict.fromkeys(merged)
    }


def merge_importances(importances: Array, names: tuple[str, ...]) -> Array:
    """Adds importances up over the observations of each group.

    Args:
        importances: Importances (..., n).
        names: Names of the observations.

    Returns:
        Importances (..., n_groups), in the order of `observation_groups`.
    """
    groups = observation_groups(names)
    return np.stack([importances[..., own].sum(axis=-1) for own in groups.values()], axis=-1)
