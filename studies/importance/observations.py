"""Observations merged over legs, as the paper's table names them."""

import re

import numpy as np
from numpy.typing import NDArray

from glassgait.models.a1 import robot
from glassgait.models.a1.robot import Array

_LEG = re.compile(rf" ({'|'.join(robot.LEGS)})\b")


def merged_name(name: str) -> str:
    """Returns an observation's name without its leg and without the machine state's number."""
    name = _LEG.sub("", name)
    return "RM State" if name.startswith("RM State") else name


def observation_groups(names: tuple[str, ...]) -> dict[str, NDArray[np.int64]]:
    """Groups observations that differ by leg alone: columns by merged name, in order."""
    merged = [merged_name(name) for name in names]
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
