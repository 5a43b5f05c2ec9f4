"""Whether what was exported moves robots as the Python policy does, in two engines."""

from collections.abc import Callable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import load_scenario
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.arrays import Array
from glassgait.models.export.binding import ACTION, LoadedController
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.command import Command, sample_commands
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.common.rollouts.roll_out import log_batch
from glassgait.studies.common.rollouts.scores import score_rollouts
from glassgait.studies.deployment.export.agreement import moments

WORLDS = {"Drake": "training", "MuJoCo": "mujoco"}
"""Scenario of each engine."""

Maker = Callable[[BatchSimulator], Callable[[int], Array]]
"""Makes what acts in a simulator: at each control step it returns the actions of all robots."""


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
        expert: Whose estimator observes.
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
    rows = []
    controller = alone(policy, expert)
    for engine, name in WORLDS.items():
        task = TaskConfig.of_scenario(gait, load_scenario(name), controller, episode_steps=n_steps)
        physics = make_physics(task.robot, load_scenario(name).station)
        scores = []
        for make in (by_policy(policy), exported):
            simulator = BatchSimulator(
                task,
                physics,
                n_robots=n_robots,
                generator=np.random.default_rng(seed),
                estimator=expert.estimator,
            )
            simulator.start_at(simulator.state.plant, command)
            log = log_batch(simulator, n_steps, _as_told(simulator, command, make(simulator)))
            scores.append(score_rollouts(log, task.robot.mass))
        rows.append(compared(engine, title, *scores))
    return pd.DataFrame(rows)


def _as_told(
    simulator: BatchSimulator, command: Command, act: Callable[[int], Array]
) -> Callable[[int], tuple[Array, NDArray[np.bool_]]]:
    """Keeps each robot's command, where the simulator would draw another one after 10 s."""
    alone = np.zeros(simulator.n_robots, dtype=bool)

    def act_as_told(step: int) -> tuple[Array, NDArray[np.bool_]]:
        simulator.set_command(command)
        return act(step), alone

    return act_as_told


def by_policy(policy: Policy) -> Maker:
    """Returns what acts by all that the simulator observes."""
    return lambda simulator: lambda step: policy(simulator.observe())


def by_graph(graph: Callable[[Array], tuple[Array, Array]]) -> Maker:
    """Returns what acts by proprioception, and estimates the rest by its own estimator."""
    return lambda simulator: lambda step: graph(simulator.observe()[:, :-N_ESTIMATED])[0]


def by_controller(compiled: LoadedController) -> Maker:
    """Returns what makes a controller for each robot, which acts by what the robot senses alone."""

    def make(simulator: BatchSimulator) -> Callable[[int], Array]:
        memories = [compiled.initial() for _ in range(simulator.n_robots)]

        def act(step: int) -> Array:
            for i, moment in enumerate(moments(simulator)):
                memories[i] = compiled.step(memories[i], *moment).memory
            return np.array(memories)[:, ACTION]

        return act

    return make


def compared(
    engine: str, title: str, python: pd.DataFrame, exported: pd.DataFrame
) -> dict[str, object]:
    """Compares the scores of robots that Python and an export moved: a row of `walk_both`."""
    earned, other = python["reward"], exported["reward"]
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
