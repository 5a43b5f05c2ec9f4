"""Whether what was exported moves robots as the Python policy does, in two engines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import Scenario, load_scenario
from glassgait.models.arrays import Array
from glassgait.models.export.binding import ACTION, LoadedController
from glassgait.models.policies.controller import (
    AlternatingController,
    Controller,
    ControllerOutput,
    WrappedController,
)
from glassgait.models.task.command import sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.studies.common.episode import BoolArray, Episode, Event, IntArray, episode
from glassgait.studies.common.observers import Log, Snapshots
from glassgait.studies.common.scores import score_rollouts
from glassgait.studies.export.agreement import Moment, moments

WORLDS = {"Drake": "training", "MuJoCo": "mujoco"}
"""Scenario of each engine."""

REQUEST_STEPS = 150
"""Control steps from one request of another gait to the next (3 s)."""

Maker = Callable[[Controller], tuple[Controller, Sequence[Event]]]
"""Returns a controller that acts in place of Python's, and the events by which it senses."""


class _Run(NamedTuple):
    """What robots did.

    Attributes:
        scores: A row a robot.
        states: State of the machine before each step until the fall, -1 after it (T, n).
    """

    scores: pd.DataFrame
    states: IntArray


def walk_both(
    gait: Gait,
    controller: AlternatingController,
    exported: Maker,
    *,
    title: str,
    n_robots: int,
    n_steps: int,
    seed: int,
) -> pd.DataFrame:
    """Rolls robots out by Python and by what was exported, in either engine.

    Both have the same robots, noise and commands: of one gait a command for each robot; of several
    new ones after 10 s, and every 3 s a request of another gait.

    Args:
        gait: The gait, or several.
        controller: The controller, in Python.
        exported: Makes what acts instead, such as `by_controller` returns.
        title: What the table calls it.
        n_robots: Number of robots.
        n_steps: Control steps.
        seed: Seed of initial states, commands, requests and noise.

    Returns:
        A row an engine: `falls` and `return` (mean) of both, and the greatest difference of a
        robot's return (share of it). Of several gaits besides `changes`, of the gait by both, and
        `robots, RM state apart`, whose machine was ever in another state.
    """
    walk = {"n_robots": n_robots, "n_steps": n_steps, "seed": seed}
    rows = []
    for engine, world in WORLDS.items():
        python, other = (
            _walked(gait, *make(controller), load_scenario(world), **walk)
            for make in (by_policy, exported)
        )
        row = compared(engine, title, python.scores, other.scores)
        rows.append(row)
    return pd.DataFrame(rows)


def _walked(
    gait: Gait,
    controller: Controller,
    senses: Sequence[Event],
    scenario: Scenario,
    *,
    n_robots: int,
    n_steps: int,
    seed: int,
) -> _Run:
    events = [_one_command(gait, n_robots, seed), *senses]
    log = Log(controller, scenario)
    snapshots = Snapshots()
    episode(
        gait,
        controller,
        scenario,
        n_robots=n_robots,
        n_steps=n_steps,
        seed=seed,
        observers=[log, snapshots],
        events=events,
    )
    scores = score_rollouts(log.rollout(n_steps), controller.robot.mass)
    states = np.array([state.machine.state for state in snapshots.states])
    upright = np.arange(len(states))[:, None] < scores["steps"].to_numpy()
    padded = np.full((n_steps, n_robots), -1)
    padded[: len(states)] = np.where(upright, states, -1)
    return _Run(scores, padded)


def _one_command(gait: Gait, n_robots: int, seed: int) -> Event:
    """Returns the event that gives each robot a command for the whole episode."""
    command = sample_commands(gait, n_robots, np.random.default_rng(seed))

    def begin(running: Episode, _: BoolArray) -> None:
        simulator = running.simulator
        simulator.start_at(simulator.state.plant, command)
        # The simulator would draw another command after 10 s.
        simulator.set_command(command)

    return Event(0, None, begin)


def by_policy(controller: Controller) -> tuple[Controller, Sequence[Event]]:
    """Returns what acts by all that the simulator observes."""
    return controller, ()


def by_graph(graph: Callable[[Array, Array], tuple[Array, Array]]) -> Maker:
    """Returns what acts by proprioception, and by odometry or else its own estimator."""
    return lambda controller: (_GraphController(controller, graph), ())


def by_controller(compiled: LoadedController) -> Maker:
    """Returns what makes a controller for each robot, which acts by what the robot senses alone."""

    def make(controller: Controller) -> tuple[Controller, Sequence[Event]]:
        acting = _CompiledController(controller, compiled)
        return acting, [Event(None, None, acting.sense)]

    return make


@dataclass(frozen=True)
class _GraphController(WrappedController):
    """Acts by a graph."""

    graph: Callable[[Array, Array], tuple[Array, Array]]

    def advance(self, step: int, observation: Array, memory: None) -> ControllerOutput:
        action = self.graph(*np.split(observation, [-N_ESTIMATED], axis=1))[0]
        return ControllerOutput(action, np.zeros(len(action), dtype=bool), memory)


@dataclass(frozen=True)
class _CompiledController(WrappedController):
    """Acts by a compiled controller for each robot, whose sensors an event reads."""

    compiled: LoadedController
    _sensed: list[Moment] = field(default_factory=list)

    def sense(self, running: Episode, _: BoolArray) -> None:
        """Reads what each robot senses now."""
        self._sensed[:] = moments(running.simulator.state, None)

    def begin(self, n_robots: int) -> list[Array]:
        return [self.compiled.initial() for _ in range(n_robots)]

    def advance(self, step: int, observation: Array, memory: list[Array]) -> ControllerOutput:
        memory = [
            self.compiled.step(own, *moment).memory
            for own, moment in zip(memory, self._sensed, strict=True)
        ]
        action = np.array(memory)[:, ACTION]
        return ControllerOutput(action, np.zeros(len(action), dtype=bool), memory)


def compared(
    engine: str, title: str, python: pd.DataFrame, exported: pd.DataFrame
) -> dict[str, object]:
    """Compares the scores of robots that Python and an export moved: a row of `walk_both`."""
    earned, other = python["return"], exported["return"]
    return {
        "engine": engine,
        "robots": len(python),
        "falls, Python": int(python["fell"].sum()),
        f"falls, {title}": int(exported["fell"].sum()),
        "return, Python": float(earned.mean()),
        f"return, {title}": float(other.mean()),
        "apart, mean (%)": 100.0 * abs(float(other.mean() / earned.mean()) - 1.0),
        "apart, robot (%)": 100.0 * float(((other - earned).abs() / earned.abs()).max()),
    }
