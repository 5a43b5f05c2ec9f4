"""Whether a controller in C changes the gaits of walking robots as Python does, in two engines."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.commands import DrawnCommands
from glassgait.diagrams.scenario import load_scenario
from glassgait.models.export.binding import LoadedController
from glassgait.models.policies.controller import alone
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.studies.common.episode import episode
from glassgait.studies.common.observers import Log, Snapshots
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.common.scores import score_rollouts
from glassgait.studies.deployment.export.closed_loop import (
    WORLDS,
    Maker,
    by_controller,
    by_policy,
    compared,
)
from glassgait.studies.deployment.export.switching_agreement import asking, drawn_requests

REQUEST_STEPS = 150
"""Control steps from one request to the next (3 s)."""


class _Run(NamedTuple):
    """What robots did that changed their gait.

    Attributes:
        scores: A row a robot.
        states: State of the machine before each step until the fall, -1 after it (T, n).
        changes: Changes of the gait of all robots.
    """

    scores: pd.DataFrame
    states: NDArray[np.int64]
    changes: int


def change_both(
    switched: SwitchedPolicy,
    compiled: LoadedController,
    *,
    n_robots: int,
    n_steps: int,
    seed: int,
) -> pd.DataFrame:
    """Rolls robots out that are asked for another gait every 3 s, by Python and by C.

    Both have the same robots, noise, requests and commands, at the speeds of distillation and new
    ones after 10 s.

    Args:
        switched: The gaits, and the policies that act and observe in each, in Python.
        compiled: The same in C.
        n_robots: Number of robots.
        n_steps: Control steps.
        seed: Seed of initial states, commands, requests and noise.

    Returns:
        A row an engine, as `walk_both` returns it; besides `changes`, of the gait by Python and by
        C, and `robots, RM state apart`, whose machine was ever in another state.
    """
    requested = drawn_requests(switched.switch, n_robots, n_steps, REQUEST_STEPS, seed)
    rows = []
    for engine, world in WORLDS.items():
        python, other = (
            _changing(switched, make, world, requested, seed)
            for make in (by_policy, by_controller(compiled))
        )
        apart = np.any(python.states != other.states, axis=0)
        rows.append(
            {
                **compared(engine, "C", python.scores, other.scores),
                "changes, Python": python.changes,
                "changes, C": other.changes,
                "robots, RM state apart": int(apart.sum()),
            }
        )
    return pd.DataFrame(rows)


def _changing(
    switched: SwitchedPolicy,
    make: Maker,
    world: str,
    requested: NDArray[np.int64],
    seed: int,
) -> _Run:
    """Rolls robots out that are asked for gaits (T, n)."""
    n_steps, n_robots = requested.shape
    speeds = DrawnCommands(distilled_speeds(switched.switch.gait))
    scenario = replace(load_scenario(world), command=speeds)
    controller, senses = make(alone(switched))
    log = Log(switched.robot, limited=scenario.limits_targets(switched))
    snapshots = Snapshots()
    episode(
        switched.switch,
        controller,
        scenario,
        n_robots=n_robots,
        n_steps=n_steps,
        seed=seed,
        observers=[log, snapshots],
        events=[*senses, asking(requested)],
    )
    scores = score_rollouts(log.rollout(n_steps), switched.robot.mass)
    states = np.array([state.machine.state for state in snapshots.states])
    upright = np.arange(len(states))[:, None] < scores["steps"].to_numpy()
    running = switched.switch.gait_of(states)
    changes = (running[1:] != running[:-1]) & upright[1:]
    padded = np.full((n_steps, n_robots), -1)
    padded[: len(states)] = np.where(upright, states, -1)
    return _Run(scores, padded, int(changes.sum()))
