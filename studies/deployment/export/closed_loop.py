"""Whether what was exported moves robots as the Python policy does, in two engines."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import load_scenario
from glassgait.diagrams.switching_batch import SwitchingSimulator
from glassgait.models.arrays import Array
from glassgait.models.export.binding import ACTION, LoadedController
from glassgait.models.policies.controller import (
    Controller,
    ControllerOutput,
    WrappedController,
    alone,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.command import sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.studies.common.episode import BoolArray, Episode, Event, World, episode
from glassgait.studies.common.observers import Log
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.common.scores import score_rollouts
from glassgait.studies.deployment.export.agreement import Moment, moments

WORLDS = {"Drake": "training", "MuJoCo": "mujoco"}
"""Scenario of each engine."""

Maker = Callable[[Controller], tuple[Controller, Sequence[Event]]]
"""Returns a controller that acts in place of Python's, and the events by which it senses."""


def walk_both(
    gait: Gait,
    policy: Policy,
    expert: NeuralPolicy,
    exported: Maker,
    *,
    title: str,
    n_robots: int,
    n_steps: int,
    seed: int,
) -> pd.DataFrame:
    """Rolls the Python policy and what was exported out in either engine.

    Both have the same robots, noise and commands, one for each robot, at the speeds of
    distillation.

    Args:
        gait: The gait.
        policy: The policy, in Python.
        expert: The expert whose estimator observes.
        exported: Makes what acts instead, such as `by_controller` returns.
        title: What the table calls it.
        n_robots: Number of robots.
        n_steps: Control steps.
        seed: Seed of initial states, commands and noise.

    Returns:
        A row an engine: `falls` and `return` (mean) of both, and the greatest difference of a
        robot's return (share of it).
    """
    command = sample_commands(gait, n_robots, np.random.default_rng(seed), distilled_speeds(gait))

    def begin(running: Episode, _: BoolArray) -> None:
        simulator = running.simulator
        simulator.start_at(simulator.state.plant, command)
        # The simulator would draw another command after 10 s.
        simulator.set_command(command)

    rows, controller = [], alone(policy, expert)
    for engine, name in WORLDS.items():
        world = World.of(gait, load_scenario(name), controller)
        scores = []
        for make in (by_policy, exported):
            acting, senses = make(controller)
            log = Log(world.task.robot, limited=world.task.limit_targets)
            episode(
                gait,
                acting,
                world,
                n_robots=n_robots,
                n_steps=n_steps,
                seed=seed,
                observers=[log],
                events=[Event(0, None, begin), *senses],
            )
            scores.append(score_rollouts(log.rollout(n_steps), world.task.robot.mass))
        rows.append(compared(engine, title, *scores))
    return pd.DataFrame(rows)


def by_policy(controller: Controller) -> tuple[Controller, Sequence[Event]]:
    """Returns what acts by all that the simulator observes."""
    return controller, ()


def by_graph(graph: Callable[[Array], tuple[Array, Array]]) -> Maker:
    """Returns what acts by proprioception, and estimates the rest by its own estimator."""
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

    graph: Callable[[Array], tuple[Array, Array]]

    def advance(self, step: int, observation: Array, memory: None) -> ControllerOutput:
        action = self.graph(observation[:, :-N_ESTIMATED])[0]
        return ControllerOutput(action, np.zeros(len(action), dtype=bool), memory)


@dataclass(frozen=True)
class _CompiledController(WrappedController):
    """Acts by a compiled controller for each robot, whose sensors an event reads."""

    compiled: LoadedController
    _sensed: list[Moment] = field(default_factory=list)

    def sense(self, running: Episode, _: BoolArray) -> None:
        """Reads what each robot senses now."""
        simulator = running.simulator
        several = isinstance(simulator, SwitchingSimulator)
        self._sensed[:] = moments(simulator.state, simulator.requested if several else None)

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
