"""Playing one robot as fast as it goes, keeping the replay, until Ctrl-C where that ends it."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import Annotated

import numpy as np
from annotated_types import Le
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.replay import save_replay
from glassgait.diagrams.rollout import Rollout, make_simulator, push, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.settings import Count
from glassgait.models.task.gait import Gait

Steps = Annotated[Count, Le(180_000)]
"""Control steps of one robot: an hour at most, which the memory holds."""


def play(
    gait: Gait,
    policy: AlternatingController,
    scenario: Scenario,
    meshcat: Meshcat,
    replay: Path,
    *,
    n_steps: int,
    seed: int = 0,
    repetitions: int = 1,
) -> Rollout:
    """Rolls a policy out and writes the replay.

    Args:
        gait: The gait.
        policy: The controller.
        scenario: The world.
        meshcat: Where the replay is drawn.
        replay: HTML file of the replay.
        n_steps: Control steps of the rollout; a fall ends it before.
        seed: Seed of noise, pushes and drawn commands.
        repetitions: How often the replay plays before it stands still.

    Raises:
        InputError: if a policy or the command does not fit the gait.
    """
    diagram = MakeLocomotion(gait, scenario, policy=policy, meshcat=meshcat)
    rollout = roll_one_out(diagram, scenario, n_steps=n_steps, seed=seed)
    save_replay(diagram, meshcat, rollout, replay, repetitions=repetitions)
    return rollout


def roll_one_out(diagram: Diagram, scenario: Scenario, *, n_steps: int, seed: int) -> Rollout:
    """Rolls one robot out as fast as it goes, pushed as the scenario says.

    Args:
        diagram: What `MakeLocomotion` built.
        scenario: The world that it was built for.
        n_steps: Control steps of the rollout; a fall ends it before.
        seed: Seed of noise, pushes and drawn commands.
    """
    simulator = make_simulator(diagram, seed=seed, accuracy=scenario.accuracy)
    pushed = pusher(simulator, scenario, seed)

    def stopped() -> bool:
        pushed()
        return False

    return record(simulator, n_steps, stopped=stopped)


def pusher(simulator: Simulator, scenario: Scenario, seed: int) -> Callable[[], None]:
    """Returns what is to be called between two control steps, so that the scenario's pushes come.

    Args:
        simulator: A simulator of what `MakeLocomotion` built.
        scenario: The world.
        seed: Seed of the pushes.
    """
    randomization, generator = scenario.randomization(), np.random.default_rng(seed)
    shown = simulator.get_system()
    assert isinstance(shown, Diagram)

    def pushed() -> None:
        if scenario.push_speed > 0:
            velocity = randomization.pushes(1, generator)[0]
            push(shown, simulator.get_mutable_context(), velocity)

    return pushed


@contextmanager
def first_interrupt() -> Iterator[Callable[[], bool]]:
    """Has the first Ctrl-C ask for the end, not break off a step; the second one breaks off."""
    asked = Event()
    usual = signal.getsignal(signal.SIGINT)

    def ask(*_: object) -> None:
        asked.set()
        signal.signal(signal.SIGINT, usual)

    signal.signal(signal.SIGINT, ask)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, usual)
