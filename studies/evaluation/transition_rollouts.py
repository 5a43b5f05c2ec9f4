"""Rolling robots out that change their gait while they walk."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.reward_machine import BoolArray, IntArray
from glassgait.models.task.termination import FAILURES
from glassgait.studies.common.episode import ControlStep, Episode, Event, Observer, episode

FIRST_STEPS = 300
"""Control steps that a robot walks in its first gait before another is requested (6 s)."""

SPREAD_STEPS = 50
"""Requests come within so many control steps, each robot's at an instant of its own (1 s)."""

AFTER_STEPS = 500
"""Control steps from the request to the end (10 s)."""

BETWEEN_STEPS = 50
"""Control steps in a gait on the way before the next is requested, and of slow walking after a
change (1 s)."""

SCORED_STEPS = 300
"""Control steps at the end whose reward is compared (6 s)."""

KEPT = 0.8
"""Share of the commanded rhythm from which a cycle counts as kept."""


@dataclass(frozen=True)
class Transition:
    """Robots that go from one gait to another at one speed.

    Attributes:
        path: The gaits, in the order in which they are requested; of one alone nothing changes.
        controllers: What acts in each.
        world: The scenario.
        speed: Commanded speed (m/s).
        n_robots: Number of robots.
        seed: Seed of initial states, dwells, instants of the request, and noise.
        patience: See `Transitions`.
        greatest_change: See `Transitions`.
        slowdown: See `Transitions`.
    """

    path: tuple[Gait, ...]
    controllers: tuple[AlternatingController, ...]
    world: Scenario
    speed: float
    n_robots: int
    seed: int
    patience: float
    greatest_change: float
    slowdown: float


class _Log(NamedTuple):
    """What n robots did over T control steps.

    Attributes:
        running: Number of the gait that ran after each step (T, n).
        served: Control steps of rhythm that transitions served (T, n).
        reward: Reward (T, n); 0 after a failure.
        failures: Flags of the failures (T, n, 7).
    """

    running: IntArray
    served: Array
    reward: Array
    failures: BoolArray


def roll_transition(job: Transition) -> pd.DataFrame:
    """Rolls a job's robots out, each with a dwell and an instant of the request of its own.

    Returns:
        A row a robot: `robot`, `dwell` (control steps); `fell`, whether it
        failed before the end, `failure`, by what, and `before`, whether that was before the
        request; `wait`, from the request of the last gait until it ran (s); `settling`, from then
        until its rhythm was kept (s), NaN where it never was; `reward`, the mean over the last
        seconds.
    """
    n = job.n_robots
    switch = GaitSwitch(job.path, job.patience)
    policy = SwitchedPolicy(switch, job.controllers, job.greatest_change)
    generator = np.random.default_rng(job.seed)
    low, high = switch.gait.dwell
    dwell = generator.integers(low, high + 1, n).astype(float)
    request = FIRST_STEPS + generator.integers(0, SPREAD_STEPS, n)
    requests = Requests(request, last=len(job.path) - 1)
    recorder = _Recorder(switch, requests)

    def ask(running: Episode, _: BoolArray) -> None:
        """Requests the gaits that are due, and slows robots down that change theirs."""
        now = running.switching.running
        requests.advance(running.step, now)
        running.switching.requested = requests.number
        slow = requests.on_the_way(running.step, now)
        speed = job.speed * np.where(slow, job.slowdown, 1.0)
        running.simulator.set_command(Command(np.stack([speed, np.zeros(n)], axis=1), dwell))

    episode(
        switch,
        policy,
        replace(job.world, command=FixedCommand(speed=job.speed, dwell=int(low))),
        n_robots=n,
        n_steps=int(request.max()) + AFTER_STEPS,
        seed=generator,
        observers=[recorder],
        events=[Event(None, None, ask)],
    )
    log = recorder.log
    rows = []
    for i in range(n):
        parts: list[Any] = [values[: request[i] + AFTER_STEPS, i] for values in log]
        own = _Log(*parts)
        rows.append(
            {
                "robot": i,
                "dwell": int(dwell[i]),
                **_score(own, job.path, int(request[i]), int(requests.asked[i])),
            }
        )
    return pd.DataFrame(rows)


def _score(log: _Log, path: Sequence[Gait], request: int, asked: int) -> dict[str, Any]:
    """Scores one robot, whose log is (T,) and (T, 6).

    Args:
        log: What it did.
        path: The gaits.
        request: Step at which the second gait was requested.
        asked: Step at which the last one was.
    """
    failed = np.any(log.failures, axis=1)
    fell = bool(failed.any())
    end = int(np.argmax(failed)) if fell else len(log.reward)
    shown = np.array(FAILURES)[log.failures[end]] if fell else []
    begun = np.flatnonzero(log.running[:end] == len(path) - 1)
    start = max(int(begun[0]), asked) if len(begun) else None
    n_states = path[-1].n_states - len(path[-1].faults)
    settled = None if start is None else settled_from(log.served[:end], start, n_states)
    return {
        "fell": fell,
        "before": fell and end < request,
        "failure": " ".join(shown),
        "wait": _seconds(start, asked),
        "settling": _seconds(settled, start),
        "reward": float(log.reward[-SCORED_STEPS:].mean()),
    }


class Requests:
    """Requests the gaits of a path one after the other, of each robot when it is due.

    Attributes:
        number: Place on the path of the gait that is requested (n,).
        asked: Control step at which the last gait was requested (n,).
    """

    def __init__(self, request: IntArray, last: int) -> None:
        """
        Args:
            request: Control steps at which the second gait is requested (n,).
            last: Place on the path of the last gait.
        """
        self.number = np.zeros_like(request)
        self.asked = request.copy()
        self._request, self._last = request, last
        # Step from which on the robot is in the requested gait, the first one at its request.
        self._since = request.copy()

    def advance(self, step: int, running: IntArray) -> None:
        """Requests the next gait of robots that have been long enough in the one before."""
        enough = np.where(self.number == 0, 0, BETWEEN_STEPS)
        due = (running == self.number) & (step - self._since >= enough) & (running < self._last)
        self.number = self.number + due
        self.asked = np.where(due, step, self.asked)

    def note(self, step: int, before: IntArray, after: IntArray) -> None:
        """Notes which robots came to another gait in a control step."""
        self._since = np.where(after != before, step + 1, self._since)

    def on_the_way(self, step: int, running: IntArray) -> BoolArray:
        """Returns which robots change, or have just changed, the gait (n,)."""
        begun = (step >= self._request) & (self._last > 0)
        return begun & ((running < self._last) | (step - self._since < BETWEEN_STEPS))


class _Recorder(Observer):
    """Records what is scored, and notes changes of the gait for the requests."""

    def __init__(self, switch: GaitSwitch, requests: Requests) -> None:
        self._switch, self._requests = switch, requests
        self._rows: list[_Log] = []

    def observe(self, step: ControlStep) -> None:
        before, after = (
            self._switch.gait_of(state.machine.state) for state in (step.before, step.after)
        )
        self._requests.note(step.step, before, after)
        outcome = step.outcome
        # A fallen robot counts no more.
        reward = np.where(step.fallen, 0.0, outcome.reward)
        self._rows.append(_Log(after, outcome.served_dwell, reward, outcome.failures))

    @property
    def log(self) -> _Log:
        """All steps."""
        return _Log(*(np.array(values) for values in zip(*self._rows, strict=True)))


def settled_from(served: Array, start: int, n_states: int) -> int | None:
    """Returns the step from which on a whole cycle of the gait kept `KEPT` of its rhythm.

    Args:
        served: Control steps of rhythm that transitions served (T,).
        start: Step at which the gait began.
        n_states: Transitions of a cycle.
    """
    changes = [start, *(start + 1 + np.flatnonzero(served[start + 1 :] > 0))]
    for first, last in zip(changes, changes[n_states:], strict=False):
        if served[first + 1 : last + 1].sum() >= KEPT * (last - first):
            return first
    return None


def _seconds(instant: int | None, since: int | None) -> float:
    if instant is None or since is None:
        return float("nan")
    return CONTROL_PERIOD * (instant - since)
