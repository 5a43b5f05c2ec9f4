"""Whether a compiled controller moves robots as the Python policy does, in two engines."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.scenario import Scenario, load_scenarios
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.a1.robot import Array
from glassgait.models.export.binding import ACTION, LoadedController
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.command import sample_commands
from glassgait.models.task.gait import Gait
from glassgait.studies.export.agreement import moments
from glassgait.studies.rollouts.config import distilled_speeds
from glassgait.studies.rollouts.roll_out import log_batch
from glassgait.studies.rollouts.scores import score_rollouts

WORLDS = {"Drake": "training", "MuJoCo": "mujoco"}
"""Scenario of each engine."""


def walk_both(
    gait: Gait,
    policy: Policy,
    expert: NeuralPolicy,
    compiled: LoadedController,
    *,
    n_robots: int,
    n_steps: int,
    seed: int,
) -> pd.DataFrame:
    """Rolls the Python policy and the compiled controller out in either engine.

    Both have the same robots, noise and commands, one for each robot, at the speeds of
    distillation.

    Returns:
        A row an engine: `falls` and `return` (mean) of both, and the greatest difference of a
        robot's return (share of it).
    """
    rows = []
    for engine, scenario in zip(WORLDS, load_scenarios(WORLDS.values()).values(), strict=True):
        scores = {}
        for who in ("Python", "C"):
            simulator = _simulator(gait, scenario, expert, n_robots, n_steps, seed)
            drawn = sample_commands(
                gait, n_robots, np.random.default_rng(seed), distilled_speeds(gait)
            )
            simulator.start_at(simulator.state.plant, drawn)
            act = _compiled(simulator, compiled) if who == "C" else _python(simulator, policy)

            def as_told(step: int, simulator=simulator, drawn=drawn, act=act) -> Array:
                # The simulator draws other commands after 10 s.
                simulator.set_command(drawn)
                return act(step)

            scores[who] = score_rollouts(log_batch(simulator, n_steps, as_told))
        rows.append(_compared(engine, scores["Python"], scores["C"]))
    return pd.DataFrame(rows)


def _simulator(
    gait: Gait, scenario: Scenario, expert: NeuralPolicy, n_robots: int, n_steps: int, seed: int
) -> BatchSimulator:
    return BatchSimulator(
        TaskConfig.of_scenario(gait, scenario, episode_steps=n_steps),
        make_physics(scenario.station),
        n_robots=n_robots,
        generator=np.random.default_rng(seed),
        estimator=expert.estimator,
    )


def _python(simulator: BatchSimulator, policy: Policy) -> Callable[[int], Array]:
    return lambda step: policy(simulator.observe())


def _compiled(simulator: BatchSimulator, compiled: LoadedController) -> Callable[[int], Array]:
    """Returns what steps one controller a robot, by what the robot senses alone."""
    memories = [compiled.initial() for _ in range(simulator.n_robots)]

    def act(step: int) -> Array:
        for i, (sensors, command) in enumerate(moments(simulator)):
            memories[i] = compiled.step(memories[i], sensors, command).memory
        return np.array(memories)[:, ACTION]

    return act


def _compared(engine: str, python: pd.DataFrame, compiled: pd.DataFrame) -> dict[str, object]:
    earned, by_c = python["reward"], compiled["reward"]
    return {
        "engine": engine,
        "robots": len(python),
        "falls, Python": int(python["fell"].sum()),
        "falls, C": int(compiled["fell"].sum()),
        "return, Python": float(earned.mean()),
        "return, C": float(by_c.mean()),
        "apart, mean (%)": 100.0 * abs(float(by_c.mean() / earned.mean()) - 1.0),
        "apart, robot (%)": 100.0 * float(((by_c - earned).abs() / earned.abs()).max()),
    }
