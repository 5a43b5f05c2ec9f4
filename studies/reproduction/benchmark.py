"""`glassgait reproduce benchmark`: measures training throughput and the time of one action."""

import resource
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd
from pydrake.common import Parallelism
from pydrake.systems.analysis import BatchEvalUniquePeriodicDiscreteUpdate
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.physics import PhysicsStep
from glassgait.diagrams.station import AddStation, StationConfig
from glassgait.models.arrays import Array
from glassgait.models.export.binding import FLAGS, compile_c, has_compiler, write_source
from glassgait.models.export.c_source import write_controller
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import Controller
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT, Robot
from glassgait.models.settings import Count, checked
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import OneGait
from glassgait.studies.common.figures import page_template
from glassgait.studies.common.policies import ALL, Policies
from glassgait.studies.common.run import CONFIG_NAME, default_folder, read_run, refuse_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students import policy_title
from glassgait.studies.export.command import controller_name
from glassgait.studies.reproduction.page import TEMPLATES
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.run import TrainingRun

Part = Literal["throughput", "actions"]

PARTS: tuple[Part, ...] = ("throughput", "actions")

STEPS = 20_000
"""Steps of a controller in C that are timed."""

CALLS = 300
"""Calls in Python that are timed."""

REPETITIONS = 5
"""Repetitions, of which the fastest is reported: the machine does other work too."""


@checked
class Benchmark(OneGait):
    """Measure training throughput and the time of one action.

    Attributes:
        parts: What to measure: training beside bare physics, and actions of policies in Python and
            in C; both by default.
        training: Folder of a training run to continue in memory, so that robots walk rather than
            fall; from the beginning by default.
        updates: Updates that are timed at once.
        repeats: Number of timings; medians are reported.
        output: Folder of the results; runs/reproduce/benchmark by default.
    """

    title: ClassVar[str] = "reproduce benchmark"

    parts: tuple[Part, ...] = PARTS
    training: Path | None = None
    updates: Count = 4
    repeats: Count = 5
    output: Path | None = None

    def run(self) -> None:
        """Measures, and writes tables."""
        robot = load_robot(self.robot or DEFAULT_ROBOT)
        folder = self.output or default_folder(self.title, robot.name)
        refuse_run(folder)
        measures: dict[str, tuple[str, Callable[[], pd.DataFrame]]] = {
            "throughput": ("Throughput", self._throughput),
            "actions": ("One action, one robot", lambda: action_times(self.policies())),
        }
        metrics: dict[str, Any] = {}
        for part in dict.fromkeys(self.parts):
            say(f"timing {part}")
            heading, measure = measures[part]
            table = measure()
            write_table(table, folder / part)
            print_table(heading, table)
            metrics[part] = json_records(table)
        # Linux counts in KiB.
        metrics["peak_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 2**10
        write_metrics(metrics, folder / "metrics.json")
        console.print(f"written to {folder}")

    def _throughput(self) -> pd.DataFrame:
        config = TrainingConfig(gait=self.gait, robot=self.robot or DEFAULT_ROBOT)
        if self.training is not None:
            settings = read_run(self.training, "train")["settings"]
            config = TrainingConfig.from_plain(settings, str(self.training / CONFIG_NAME))
        return throughput(config, self.training, self.updates, self.repeats)


def action_times(found: Policies, steps: int = STEPS) -> pd.DataFrame:
    """Times an action of each policy in Python, and a whole control step in C if it compiles.

    Returns:
        A row a policy: median of an action in Python (µs); of the controller in C the median and
        the 99.9th percentile of a step (µs), and the size of its file (kB).
    """
    if not has_compiler():
        say("there is no C compiler here, cc: controllers in C are not timed")
    rows = []
    for kind, controller in found.controllers([ALL]).items():
        policy = controller.policy
        observation = np.random.default_rng(0).normal(size=(1, len(policy.observation_names)))
        row: dict[str, Any] = {"policy": policy_title(kind)}
        row["action in Python (µs)"] = round(call_time(policy, observation), 1)
        if has_compiler():
            row |= step_times(found.gait, controller, kind, steps)
        rows.append(row)
    return pd.DataFrame(rows)


def call_time(call: Callable[[Any], Any], argument: Any) -> float:
    """Returns the median time of a call (µs)."""
    times = np.empty(CALLS)
    for k in range(CALLS):
        begun = time.perf_counter()
        call(argument)
        times[k] = time.perf_counter() - begun
    return 1e6 * float(np.median(times))


def step_times(gait: Gait, controller: Controller, kind: str, steps: int) -> dict[str, float]:
    """Compiles a controller, and times its step on random sensors, several times."""
    written = write_controller(
        gait,
        controller,
        name=controller_name(gait.name, kind),
        policy_name=kind,
        version=version("glassgait"),
    )
    # The harness includes the controller's file and calls its step.
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        size = write_source(written, folder).stat().st_size
        harness = page_template(TEMPLATES, "step_times.c").render(
            name=written.name,
            real=written.real,
            count=steps,
            speed=0.5 * gait.max_speed,
            dwell=gait.dwell[0],
            has_imu=written.has_imu,
        )
        write_atomically(folder / "step_times.c", harness)
        compile_c(folder / "step_times.c", folder / "step_times", FLAGS)
        # The fastest run counts: other work of the machine only adds time.
        runs = [
            subprocess.run([folder / "step_times"], check=True, capture_output=True, text=True)
            for _ in range(REPETITIONS)
        ]
    median, late = min(tuple(map(float, run.stdout.split())) for run in runs)
    return {
        "step in C (µs)": median,
        "step in C, 99.9 % (µs)": late,
        "C file (kB)": round(size / 1000),
    }


def throughput(
    config: TrainingConfig, checkpoint: Path | None, n_updates: int, repeats: int
) -> pd.DataFrame:
    """Times training and its physics: a row each, with training's share.

    Args:
        config: The training run.
        checkpoint: Folder of a run to start from, or None to start at the beginning.
        n_updates: Updates to time at once.
        repeats: Number of turns, of which medians are reported.
    """
    pairs = pd.DataFrame(training_and_physics(config, checkpoint, n_updates, repeats))
    training, bare = pairs["training"].median(), pairs["physics"].median()
    share = (pairs["training"] / pairs["physics"]).median()
    rows = [
        (f"PPO training, {config.n_robots} robots", training, "1"),
        ("BatchEvalUniquePeriodicDiscreteUpdate only, same states", bare, f"{share:.2f} of it"),
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
    # MuJoCo's share is left out, so that both time Drake only.
    config = replace(config, worlds=replace(config.worlds, mujoco_share=0.0))
    with tempfile.TemporaryDirectory() as temporary:
        folder = checkpoint or Path(temporary)
        gait = load_gait(config.gait)
        run = TrainingRun(config, gait, folder, resume=checkpoint is not None)
    robot = load_robot(config.robot)
    stations = config.worlds.stations(robot, np.random.default_rng(config.seed))
    physics, recorded = _BarePhysics(robot, stations), _record_steps(run)
    # The first update warms caches and is not timed.
    run.update()
    rows = []
    for _ in range(repeats):
        recorded.clear()
        n_steps = n_updates * config.ppo.steps_per_update * config.n_robots
        training = _seconds(lambda: [run.update() for _ in range(n_updates)])
        bare = _seconds(lambda: [physics.step(*pair) for pair in recorded])
        rows.append({"training": n_steps / training, "physics": n_steps / bare})
    return rows


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


def _seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
