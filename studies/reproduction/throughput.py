"""Training throughput against bare physics, and against gymnasium's processes."""

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
    speeds = pairs.median()
    shares = pairs[["late_physics", "physics"]].rdiv(pairs["training"], axis=0).median()
    late, bare = (f"{share:.2f} of it" for share in shares)
    rows = [
        (f"PPO training, {config.n_robots} robots", speeds["training"], "1"),
        ("its physics alone, latencies included", speeds["late_physics"], late),
        (
            "bare BatchEvalUniquePeriodicDiscreteUpdate, same states and targets",
            speeds["physics"],
            bare,
        ),
        (
            "AsyncVectorEnv of 16 DrakeGymEnv over the diagram, no learning",
            processes,
            f"{speeds['training'] / processes:.1f} times it",
        ),
    ]
    table = pd.DataFrame(rows, columns=pd.Index(["what", "control steps/s", "training is"]))
    return table.assign(**{"control steps/s": table["control steps/s"].round().astype(int)})


def training_and_physics(
    config: TrainingConfig, checkpoint: Path | None, n_updates: int, repeats: int
) -> list[dict[str, float]]:
    """Times updates of PPO, and physics over the very same states and targets.

    Physics is timed as training steps it, latencies included, and bare: Drake's, in all groups. All
    are timed in turn, `repeats` times, so that they meet the machine's moods alike.

    Returns:
        Control steps/s of `training`, `late_physics` and bare `physics`, a row a turn.
    """
    config = replace(config, worlds=replace(config.worlds, mujoco_share=0.0))
    with TemporaryDirectory() as temporary:
        folder = checkpoint or Path(temporary)
        gait = load_gait(config.gait)
        run = TrainingRun(config, gait, folder, resume=checkpoint is not None)
    robot = load_robot(config.robot)
    stations = config.worlds.stations(robot, np.random.default_rng(config.seed))
    physics = _BarePhysics(robot, stations)
    late_step, recorded = _record_steps(run)
    run.update()
    rows = []
    for _ in range(repeats):
        recorded.clear()
        n_steps = n_updates * config.ppo.steps_per_update * config.n_robots
        training = _seconds(lambda: [run.update() for _ in range(n_updates)])
        late = _seconds(lambda: [late_step(*pair, **delays) for *pair, delays in recorded])
        bare = _seconds(lambda: [physics.step(*pair) for *pair, _ in recorded])
        speeds = {"training": training, "late_physics": late, "physics": bare}
        rows.append({name: n_steps / seconds for name, seconds in speeds.items()})
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
    """One call of Drake's batch evaluation a group and control step, and nothing else."""

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


_Step = tuple[Array, Array, dict[str, Array]]


def _record_steps(run: TrainingRun) -> tuple[Callable[..., PhysicsStep], list[_Step]]:
    """Returns what steps the run's physics, and a list that its steps are recorded in."""
    physics = run.environment.simulator.physics
    recorded: list[_Step] = []
    step = physics.step

    def recording_step(states: Array, targets: Array, **late: Array) -> PhysicsStep:
        delays = {name: values.copy() for name, values in late.items()}
        recorded.append((states.copy(), targets.copy(), delays))
        return step(states, targets, **late)

    setattr(physics, "step", recording_step)  # noqa: B010
    return step, recorded


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
        # Drake calls the handler with a seed that its own hint leaves out.
        reset_handler=lambda simulator, context, seed=None: set_plant_state(diagram, context),
    )


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
