"""Playing one robot at real time in Meshcat, until a person has seen enough."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.replay import save_replay
from glassgait.diagrams.rollout import KEPT_STEPS, Rollout, make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import Day, lying_state
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.console import console, say
from glassgait.studies.common.play import first_interrupt, pusher

STOP_BUTTON = "stop and save"

FALLEN_SECONDS = 1.0
"""Time that a robot lies before it is put back on its feet (s)."""


def play_live(
    gait: Gait | GaitSwitch,
    policy: AlternatingController,
    scenario: Scenario,
    meshcat: Meshcat,
    replay: Path,
    *,
    seed: int = 0,
    day: Day | None = None,
) -> Rollout:
    """Rolls a policy out at real time until the button or Ctrl-C ends it, and writes the replay.

    A robot that falls is put back on its feet where it began, the machine in its initial state. A
    robot with a day begins on its belly, and is not put back: its day goes on where it fell.

    Args:
        gait: The gait, or several, each with a button that changes to it.
        policy: The controller.
        scenario: The world.
        meshcat: Where the robot shows.
        replay: HTML file of the replay.
        seed: Seed of noise, pushes and drawn commands; each fall adds 1.
        day: The robot's day, with a button for each request; by default the policy always acts.

    Returns:
        The last minute, falls included, on a clock that starts with the first step.

    Raises:
        InputError: if a policy does not fit the gait.
    """
    # Before the gaits' buttons, which stay where they are only as the last controls.
    meshcat.AddButton(STOP_BUTTON, "Escape")
    diagram = MakeLocomotion(gait, scenario, policy=policy, meshcat=meshcat, day=day)
    buttons = [] if isinstance(gait, Gait) else ["gaits"]
    buttons += [] if day is None else ["requests"]
    steered = f"use sliders and buttons of {' and '.join(buttons)}" if buttons else "move sliders"
    console.print(
        f"open {meshcat.web_url()} and {steered} under 'Open Controls', or a gamepad; "
        f"'{STOP_BUTTON}' there, or Ctrl-C here, ends and saves the last minute"
    )
    lying = None
    if day is not None:
        lying = lying_state(policy.robot, day, np.zeros((1, quadruped.N_JOINTS)))[0]
    with first_interrupt() as interrupted:

        def stopped() -> bool:
            return interrupted() or meshcat.GetButtonClicks(STOP_BUTTON) > 0

        def live(n_falls: int) -> Rollout:
            own = seed + n_falls
            simulator = make_simulator(
                diagram, seed=own, state=lying, accuracy=scenario.accuracy, realtime_rate=1.0
            )
            pushed = pusher(simulator, scenario, own)
            return _until_fallen(simulator, pushed, stopped, stop_on_failure=day is None)

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
    simulator: Simulator,
    pushed: Callable[[], None],
    stopped: Callable[[], bool],
    *,
    stop_on_failure: bool,
) -> Rollout:
    def ended() -> bool:
        pushed()
        return stopped()

    return record(simulator, None, stop_on_failure=stop_on_failure, stopped=ended)


def _joined(before: Rollout, after: Rollout) -> Rollout:
    """Appends a rollout from time 0 on, and keeps the last minute."""
    time = np.concatenate([before.time, before.time[-1] + CONTROL_PERIOD + after.time])
    values = {name: np.concatenate([before[name], after[name]]) for name in before.values}
    last = slice(-KEPT_STEPS - 1, None)
    return Rollout(time[last], {name: value[last] for name, value in values.items()})
