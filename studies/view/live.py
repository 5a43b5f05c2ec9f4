"""Plays one robot in real time in Meshcat until a person stops it."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event

import numpy as np
from pydrake.geometry import Meshcat

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import KEPT_STEPS, Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import save_replay
from glassgait.models.policies.controller import Controller
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.rollouts import pusher

STOP_BUTTON = "stop and save"

FALLEN_SECONDS = 1.0  # time from a fall to the restart (s)


def play_live(
    gait: Gait, policy: Controller, scenario: Scenario, meshcat: Meshcat, replay: Path, *, seed: int
) -> Rollout:
    """Rolls out a policy in real time until the button or Ctrl-C ends it, and writes the replay.

    A robot that falls restarts with the next seed. Returns the last minute, including falls.
    """
    # The diagram is built once: a restart only sets its state.
    meshcat.AddButton(STOP_BUTTON, "Escape")
    diagram = MakeLocomotion(gait, scenario, policy=policy, meshcat=meshcat)
    console.print(
        f"open {meshcat.web_url()} and move sliders under 'Open Controls'; "
        f"'{STOP_BUTTON}' there, or Ctrl-C here, ends and saves the last minute"
    )
    with _first_interrupt() as interrupted:

        def stopped() -> bool:
            return interrupted() or meshcat.GetButtonClicks(STOP_BUTTON) > 0

        def live(n_falls: int) -> Rollout:
            simulator = make_simulator(diagram, seed=seed + n_falls)
            simulator.set_target_realtime_rate(1.0)
            pushed = pusher(simulator, scenario, seed + n_falls)
            # `pushed` applies the pushes and returns None, so that it does not end the rollout.
            return record(simulator, None, stopped=lambda: bool(pushed()) or stopped())

        # Each fall ends a rollout; the next one is appended.
        n_falls, rollout = 0, live(0)
        while not stopped():
            n_falls += 1
            say(f"fell after {rollout.time[-1]:.2f} s; back on its feet")
            time.sleep(FALLEN_SECONDS)
            rollout = _joined(rollout, live(n_falls))
        say("saving")
        save_replay(diagram, meshcat, rollout, replay)
    return rollout


def _joined(before: Rollout, after: Rollout) -> Rollout:
    """Appends a rollout that begins at time 0, and keeps the last minute."""
    time = np.concatenate([before.time, before.time[-1] + CONTROL_PERIOD + after.time])
    values = {name: np.concatenate([before[name], after[name]]) for name in before}
    last = slice(-KEPT_STEPS - 1, None)
    return Rollout(time[last], {name: value[last] for name, value in values.items()})


@contextmanager
def _first_interrupt() -> Iterator[Callable[[], bool]]:
    """Makes the first Ctrl-C request a stop after the step; the second one interrupts at once."""
    requested = Event()
    previous = signal.getsignal(signal.SIGINT)

    def request(*_: object) -> None:
        requested.set()
        signal.signal(signal.SIGINT, previous)

    signal.signal(signal.SIGINT, request)
    try:
        yield requested.is_set
    finally:
        signal.signal(signal.SIGINT, previous)
