"""Playing one robot at real time in Meshcat, until a person has seen enough."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import KEPT_STEPS, Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import save_replay
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.rollouts import first_interrupt, pusher

STOP_BUTTON = "stop and save"

FALLEN_SECONDS = 1.0
"""Time that a robot lies before it is put back on its feet (s)."""


def play_live(
    gait: Gait,
    policy: AlternatingController,
    scenario: Scenario,
    meshcat: Meshcat,
    replay: Path,
    *,
    seed: int = 0,
) -> Rollout:
    """Rolls a policy out at real time until the button or Ctrl-C ends it, and writes the replay.

    A robot that falls is put back on its feet where it began, the machine in its initial state.

    Args:
        gait: The gait.
        policy: The controller.
        scenario: The world.
        meshcat: Where the robot shows.
        replay: HTML file of the replay.
        seed: Seed of noise, pushes and drawn commands; each fall adds 1.

    Returns:
        The last minute, falls included, on a clock that starts with the first step.

    Raises:
        InputError: if a policy does not fit the gait.
    """
    meshcat.AddButton(STOP_BUTTON, "Escape")
    diagram = MakeLocomotion(gait, scenario, policy=policy, meshcat=meshcat)
    console.print(
        f"open {meshcat.web_url()} and move sliders under 'Open Controls', or a gamepad; "
        f"'{STOP_BUTTON}' there, or Ctrl-C here, ends and saves the last minute"
    )
    with first_interrupt() as interrupted:

        def stopped() -> bool:
            return interrupted() or meshcat.GetButtonClicks(STOP_BUTTON) > 0

        def live(n_falls: int) -> Rollout:
            own = seed + n_falls
            simulator = make_simulator(
                diagram, seed=own, accuracy=scenario.accuracy, realtime_rate=1.0
            )
            return _until_fallen(simulator, pusher(simulator, scenario, own), stopped)

        rollout = _until(stopped, live)
        say("saving")
        save_replay(diagram, meshcat, rollout, replay)
    return rollout


def _until(stopped: Callable[[], bool], live: Callable[[int], Rollout]) -> Rollout:
    n_falls = 0
    rollout = live(n_falls)
    while not stopped():
        n_falls += 1
        say(f"fell after {rollout.time[-1]:.2f} s; back on its feet")
        time.sleep(FALLEN_SECONDS)
        rollout = _joined(rollout, live(n_falls))
    return rollout


def _until_fallen(
    simulator: Simulator, pushed: Callable[[], None], stopped: Callable[[], bool]
) -> Rollout:
    def ended() -> bool:
        pushed()
        return stopped()

    return record(simulator, None, stopped=ended)


def _joined(before: Rollout, after: Rollout) -> Rollout:
    """Appends a rollout from time 0 on, and keeps the last minute."""
    time = np.concatenate([before.time, before.time[-1] + CONTROL_PERIOD + after.time])
    values = {name: np.concatenate([before[name], after[name]]) for name in before.values}
    last = slice(-KEPT_STEPS - 1, None)
    return Rollout(time[last], {name: value[last] for name, value in values.items()})
