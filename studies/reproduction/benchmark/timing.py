"""Timing on a machine that does other work too: the least of several repetitions."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

REPETITIONS = 5
"""Repetitions, of which the fastest is reported."""


@dataclass(frozen=True)
class Times:
    """How long a call takes.

    Attributes:
        median: By the clock on the wall (µs).
        late: 99.9th percentile by the thread's own clock (µs), which does not run while the machine
            does other work.
    """

    median: float
    late: float


def fastest(measure: Callable[[], Sequence[Times]]) -> tuple[Sequence[Times], float]:
    """Measures several times, and returns the repetition whose first median is the least.

    Returns:
        Its times, and the machine's load after it (average number of processes that would run, over
        a minute).
    """
    found = [(measure(), os.getloadavg()[0]) for _ in range(REPETITIONS)]
    return min(found, key=lambda one: one[0][0].median)


def call_times(call: Callable[[Any], Any], rows: np.ndarray, count: int) -> Times:
    """Times calls on one row after the other (m, n), the first again after the last."""
    wall, thread = np.empty(count), np.empty(count)
    for k in range(count):
        row = rows[k % len(rows)]
        own, begun = time.thread_time(), time.perf_counter()
        call(row)
        wall[k] = time.perf_counter() - begun
        thread[k] = time.thread_time() - own
    return Times(1e6 * float(np.median(wall)), 1e6 * float(np.quantile(thread, 0.999)))
