"""The two processes: a robot that is simulated at real time, and a controller that answers it."""

import gc
import os
import time
from collections import Counter, deque
from collections.abc import Callable
from enum import IntEnum

import numpy as np

from glassgait.diagrams.answering import AnsweringEnd
from glassgait.diagrams.simulated_robot import SimulatedRobot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.console import say

Record = dict[str, float]
"""What a process counted, by name."""

KEPT = 500_000
"""Instants that are remembered, the latest ones: of almost three hours."""

MILLISECONDS = 1e3

LISTENING = 0.1
"""Time for which a controller listens before it asks whether to end (s)."""

FASTEST = 1.5
"""How much faster than the clock a process goes that was held up."""

SHORTEST = 1e-3
"""Time below which a wait is not spent listening (s)."""

SILENCE = 1.0
"""Time without sensors that is reported (s)."""

FOREIGN = (
    "a message came that is of another kind, or of another version: it was passed over; run both "
    "processes of one version, or give them a link of their own"
)


class RobotProcess:
    """Runs a robot at real time."""

    def __init__(
        self,
        robot: SimulatedRobot,
        *,
        patience: float = 0.0,
        pushed: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Args:
            robot: The robot.
            patience: Time to wait for the answer to each message of sensors (s).
            pushed: Called between two control steps.
        """
        self._robot, self._patience, self._pushed = robot, patience, pushed
        self._pace = Pace(self._listen, slack=robot.slack)
        self._sent_at: float | None = None
        self._answer_times: deque[float] = deque(maxlen=KEPT)
        self._steps = Counter[IntEnum]()
        self._begun = Counter[IntEnum]()
        self._falls = 0
        self._warned = False

    def run(self, n_steps: int | None, stopped: Callable[[], bool]) -> Record:
        """Simulates until it is asked to end.

        Args:
            n_steps: Control steps to take; None for no end but `stopped`.
            stopped: Asked at every control step whether to end.

        Returns:
            What was counted, by name.
        """
        spare_collection()
        robot, begun = self._robot, time.monotonic()
        phase = robot.phase
        while not stopped() and (n_steps is None or robot.step < n_steps):
            self._take_step()
            phase = self._reported(phase)
            if robot.fallen:
                self._falls += 1
                say(f"{self._now:.2f} s: the robot fell; back on its feet")
                robot.put_back()
                phase = robot.phase
            self._pushed()
        return self._record(time.monotonic() - begun)

    @property
    def _now(self) -> float:
        return self._robot.step * CONTROL_PERIOD

    def _take_step(self) -> None:
        robot = self._robot
        step = robot.step
        for part in range(robot.n_parts):
            self._pace.wait_until(step, part / robot.n_parts)
            if part == 0:
                robot.send()
                self._sent_at = time.monotonic()
                self._listen_for(self._patience)
            robot.advance(part)
            self._note_answer()
            if robot.n_foreign and not self._warned:
                self._warned = True
                say(FOREIGN)

    def _listen_for(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while not self._robot.answered and (left := end - time.monotonic()) > 0.0:
            self._listen(left)

    def _listen(self, seconds: float) -> None:
        """Spends some time, of which messages take none."""
        if seconds < SHORTEST:
            time.sleep(seconds)
            seconds = 0.0
        self._robot.listen(seconds)
        self._note_answer()

    def _note_answer(self) -> None:
        if self._sent_at is not None and self._robot.answered:
            self._answer_times.append(time.monotonic() - self._sent_at)
            self._sent_at = None

    def _reported(self, before: IntEnum) -> IntEnum:
        phase, reported = self._robot.phase, self._robot.reported
        self._steps[phase] += 1
        if phase != before:
            self._begun[phase] += 1
            if (before, phase) in reported:
                say(f"{self._now:.2f} s: {reported[before, phase]}")
        return phase

    def _record(self, wall: float) -> Record:
        robot, pace = self._robot, self._pace
        return {
            "simulated (s)": self._now,
            "on the wall (s)": wall,
            **robot.counts(),
            "share of steps held": self._steps[robot.held] / max(robot.step, 1),
            **{name: self._begun[phase] for name, phase in robot.counted.items()},
            "falls": self._falls,
            **pace.jitter(),
            "slips": pace.slips,
            "slipped (s)": pace.slipped,
            **spread("time to an answer", np.array(self._answer_times)),
            "load of the machine, 1 minute": os.getloadavg()[0],
            "processors": float(os.cpu_count() or 0),
        }


def control(controller: AnsweringEnd, stopped: Callable[[], bool]) -> Record:
    """Answers until it is asked to end.

    Returns:
        What was counted, by name.
    """
    spare_collection()
    taken: deque[float] = deque(maxlen=KEPT)
    try:
        answered = _answer_until(controller, stopped, taken)
    finally:
        # Whatever ended it, the robot is not left to its last command.
        controller.leave()
    return {
        "answers sent": answered,
        **controller.counts(),
        **spread("time of a step", np.array(taken)),
    }


def _answer_until(
    controller: AnsweringEnd, stopped: Callable[[], bool], taken: deque[float]
) -> int:
    """Answers until it is asked to end, notes how long each answer took (s), and counts them."""
    answered, last, hears, warned = 0, time.monotonic(), False, False
    while not stopped():
        controller.listen(LISTENING)
        if controller.n_foreign and not warned:
            warned = True
            say(FOREIGN)
        now = time.monotonic()
        if controller.answer():
            answered, last = answered + 1, time.monotonic()
            taken.append(last - now)
            if not hears:
                say("answering a robot")
                hears = True
        elif hears and now - last > SILENCE:
            say("the robot is silent")
            hears = False
        if (news := controller.news()) is not None:
            say(news)
    return answered


def spare_collection() -> None:
    """Has the collection of garbage pass over all that there is now.

    To go through what libraries made as they were loaded takes 60 ms, three control steps.
    """
    gc.collect()
    gc.freeze()


class Pace:
    """Waits for control instants, 20 ms apart.

    A process that was held up goes on faster until it is in time again, though never so fast that a
    robot's controller had no time to answer. Where it is late by more than its slack, the clock is
    put back, which counts as a slip.

    Attributes:
        slips: How often that was.
        slipped: By how much in all (s).
    """

    def __init__(
        self, wait: Callable[[float], None] = time.sleep, *, slack: float = CONTROL_PERIOD
    ) -> None:
        """
        Args:
            wait: Called with seconds to spend; it may come back early.
            slack: By how much the process may be late before the clock is put back (s).
        """
        self.slips, self.slipped = 0, 0.0
        self._wait, self._slack = wait, slack
        self._last, self._left_at = 0.0, -np.inf
        self._start: float | None = None
        self._begun: deque[float] = deque(maxlen=KEPT)

    def wait_until(self, step: int, share: float) -> None:
        """Waits for an instant."""
        now = time.monotonic()
        due = (step + share) * CONTROL_PERIOD
        if self._start is None:
            self._start = now - due
        behind = now - self._start - due
        if behind > self._slack:
            self.slips, self.slipped = self.slips + 1, self.slipped + behind
            self._start += behind
        earliest = self._left_at + (due - self._last) / FASTEST
        while (left := max(self._start + due, earliest) - time.monotonic()) > 0.0:
            self._wait(left)
        self._last, self._left_at = due, time.monotonic()
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
