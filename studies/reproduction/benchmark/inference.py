"""Time of one action: a compiled policy in NumPy against its library's `predict`."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from glassgait.models.arrays import Array


def single_row_microseconds(policy: Callable[[Array], Any], observation: Array) -> float:
    """Returns the median time of one call (µs) on one observation (n,)."""
    for _ in range(20):
        policy(observation)
    times = []
    for _ in range(300):
        start = time.perf_counter()
        policy(observation)
        times.append(time.perf_counter() - start)
    return 1e6 * float(np.median(times))
