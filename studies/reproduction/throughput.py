"""Measures training throughput against bare physics and against gymnasium's processes."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium as gym
import numpy as np
import pandas as pd
from gymnasium.vector import AsyncVectorEnv
from pydrake.common import Parallelism
from pydrake.gym import DrakeGymEnv
from pydrake.systems.analysis import BatchEvalUniquePeriodicDiscreteUpdate, Simulator
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.gym import action_space, observation_space
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.physics import PhysicsStep
from glassgait.diagrams.rollout import set_plant_state
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import say
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.run import TrainingRun


def throughput(
    config: TrainingConfig, checkpoint: Path | None, n_updates: int, repeats: int, gym_steps: int
) -> pd.DataFrame:
    """Times training, its physics and gymnasium's processes: a row each, with training's share.

    Args:
        config: The training run.
        checkpoint: Folder of a run to start from, or None to start at the beginning.
        n_updates: Updates to time at once.
        repeats: Number of turns, of which medians are reported.
        gym_steps: Steps of gymnasium's sixteen environments.
    """
    say("timing training and bare physics in turn")
    pairs = pd.DataFrame(training_and_physics(config, checkpoint, n_updates, repeats))
    say("timing gymnasium's AsyncVectorEnv of DrakeGymEnv, 16 environments")
    processes = gymnasium_processes(16, gym_steps)
    training, bare = pairs["training"].median(), pairs["physics"].median()
    share = (pairs["training"] / pairs["physics"]).median()
    rows = [
        (f"PPO training, {config.n_robots} robots", training, "1"),
        ("BatchEvalUniquePeriodicDiscreteUpdate only, same states", bare, f"{share:.2f} of it"),
        (
            "AsyncVectorEnv of 16 DrakeGymEnv over the diagram, no learning",
            processes,
            f"{training / processes:.1f} times it",
        ),
    ]
    table = pd.DataFrame(rows, columns=pd.Index(["what", "control steps/s", "training is"]))
    return table.round({"control steps/s": 0})


def training_and_physics(
    config: TrainingConfig, checkpoint: Path | None, n_updates: int, repeats: int
) -> list[dict[str, float]]:
    """Times updates of PPO, and Drake's physics over the same states and targets.

    Both are timed in turn, so that they meet the same other load of the machine.

    Returns:
        Control steps/s of `training` and bare `physics`, a row a turn.
    """
    config = replace(config, worlds=replace(config.worlds, mujoco_share=0.0))
    with TemporaryDirectory() as temporary:
        folder = checkpoint or Path(temporary)
        gait = load_gait(config.gait)
        run = TrainingRun(config, gait, folder, resume=checkpoint is not None)
    robot = load_robot(config.robot)
    stations = config.worlds.stations(robot, np.random.default_rng(config.seed))
    physics, recorded = _BarePhysics(robot, stations), _record_steps(run)
    run.update()
    rows = []
    for _ in range(repeats):
        recorded.clear()
        n_steps = n_updates * config.ppo.steps_per_update * config.n_robots
        training = _seconds(lambda: [run.update() for _ in range(n_updates)])
        bare = _seconds(lambda: [physics.step(*pair) for pair in recorded])
        rows.append({"training": n_steps / training, "physics": n_steps / bare})
    return rows


def gymnasium_processes(n_envs: int, n_processes_steps: int) -> float:
    """Times `DrakeGymEnv` over the full diagram in `AsyncVectorEnv`; returns control steps/s."""
    envs = AsyncVectorEnv([_drake_gym_env] * n_envs)
    try:
        envs.reset(seed=0)
        generator = np.random.default_rng(0)
        actions = generator.normal(scale=0.3, size=(n_processes_steps, n_envs, quadruped.N_JOINTS))
        envs.step(actions[0])
        seconds = _seconds(lambda: [envs.step(action) for action in actions])
    finally:
        envs.close()
    return n_envs * n_processes_steps / seconds


class _BarePhysics:
    """Calls Drake's batch evaluation for each group and control step, and nothing else."""

    def __init__(self, robot: Robot, stations: Sequence[StationConfig]) -> None:
        self._groups = []
        for station in stations:
            builder = DiagramBuilder()
            plant, _, instance = AddStation(builder, robot, station)
            builder.ExportInput(plant.get_desired_state_input_port(instance), "desired_state")
            diagram = builder.Build()
            n_steps = round(CONTROL_PERIOD / station.time_step)
            self._groups.append((diagram, diagram.CreateDefaultContext(), n_steps))

    def step(self, states: Array, targets: Array) -> None:
        desired = np.hstack([targets, np.zeros_like(targets)])
        n = len(self._groups)
        parts = zip(np.array_split(states, n), np.array_split(desired, n), strict=True)
        for (diagram, context, n_steps), (mine, inputs) in zip(self._groups, parts, strict=True):
            BatchEvalUniquePeriodicDiscreteUpdate(
                diagram,
                context,
                times=np.zeros(len(mine)),
                states=mine.T,
                inputs=inputs.T,
                num_time_steps=n_steps,
                parallelize=Parallelism.Max(),
            )


def _record_steps(run: TrainingRun) -> list[tuple[Array, Array]]:
    """Returns a list that records the states and targets of the run's physics from now on."""
    physics = run.environment.simulator.physics
    recorded: list[tuple[Array, Array]] = []
    step = physics.step

    def recording_step(states: Array, targets: Array, **late: Array) -> PhysicsStep:
        recorded.append((states.copy(), targets.copy()))
        return step(states, targets, **late)

    setattr(physics, "step", recording_step)  # noqa: B010
    return recorded


def _drake_gym_env() -> gym.Env:
    gait = load_gait("trot")
    diagram = MakeLocomotion(gait, Scenario(sensor_noise=0.0))
    return DrakeGymEnv(
        simulator=Simulator(diagram),
        time_step=CONTROL_PERIOD,
        action_space=action_space(),
        observation_space=observation_space(gait),
        reward="reward",
        action_port_id="actions",
        observation_port_id="observations",
        # Drake passes a seed, which its type hint leaves out.
        reset_handler=lambda simulator, context, seed=None: set_plant_state(diagram, context),
    )


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
