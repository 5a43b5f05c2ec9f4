"""The alternation of expert and student within an episode (paper, Algorithm 1)."""

import numpy as np
from numpy.typing import NDArray


def expert_acts(step: int | NDArray[np.int64], period: int) -> np.bool_ | NDArray[np.bool_]:
    """Tells whether the expert acts at a control step (...), counted from the episode's start.

    Args:
        step: Control steps since the episode's start (...).
        period: 1 is the expert alone, n is the alternation ratio 1/n, 0 is the student alone.
    """
    if period == 0:
        return np.zeros(np.shape(step), dtype=bool)
    return np.asarray(step) % period == 0


def ratio_title(period: int) -> str:
    """Writes a period as the paper's alternation ratio."""
    return {0: "0", 1: "1"}.get(period, f"1/{period}")
