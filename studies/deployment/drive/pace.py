"""Keeping step with the clock on the wall, and telling how well it was kept."""

import time
from collections import deque
from collections.abc import Callable

import numpy as np

from glassgait.models.task import CONTROL_PERIOD

KEPT = 500_000
"""Instants that are remembered, the latest ones: of almost three hours."""

MILLISECONDS = 1e3


class Pace:
    """Waits for control instants, 20 ms apart.

    A process that is late by more than a control step does not hurry after the clock: a robot's
    controller would have no time to answer. The clock is put back then, which counts as a slip.

    Attributes:
        slips: How often that was.
        slipped: By how much in all (s).
    """

    def __init__(self, wait: Callable[[float], None] = time.sleep) -> None:
        """
        Args:
            wait: Called with seconds to spend; it may come back early.
        """
        self.slips, self.slipped = 0, 0.0
        self._wait = wait
        self._start: float | None = None
        self._begun: deque[float] = deque(maxlen=KEPT)

    def wait_until(self, step: int, share: float) -> None:
        """Waits for an instant.

        Args:
            step: Control step, counted from 0.
            share: Share of the step after which the instant is.
        """
        now = time.monotonic()
        due = (step + share) * CONTROL_PERIOD
        if self._start is None:
            self._start = now - due
        behind = now - self._start - due
        if behind > CONTROL_PERIOD:
            self.slips, self.slipped = self.slips + 1, self.slipped + behind
            self._start += behind
        while (left := self._start + due - time.monotonic()) > 0.0:
            self._wait(left)
        if share == 0.0:
            self._begun.append(time.monotonic())

    def jitter(self) -> dict[str, float]:
        """Returns by how much steps were longer or shorter than 20 ms (ms); NaN without any."""
        steps = np.abs(np.diff(self._begun) - CONTROL_PERIOD)
        return spread("step jitter", steps)


def spread(name: str, seconds: np.ndarray) -> dict[str, float]:
    """Returns median, 99.9th percentile and maximum of times (n; s), in ms."""
    if not len(seconds):
        seconds = np.array([np.nan])
    median, high, most = np.quantile(seconds, [0.5, 0.999, 1.0]) * MILLISECONDS
    return {
        f"{name}, median (ms)": float(median),
        f"{name}, 99.9th percentile (ms)": float(high),
        f"{name}, greatest (ms)": float(most),
    }
