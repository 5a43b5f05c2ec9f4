"""`glassgait reproduce benchmark`: measures training throughput and the time of one action."""

import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
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
from glassgait.studies.common.run import default_folder, refuse_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.export.command import controller_name
from glassgait.studies.reproduction.page import TEMPLATES
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.run import TrainingRun

Part = Literal["throughput", "actions"]

PARTS: dict[Part, str] = {"throughput": "Throughput", "actions": "One action, one robot"}
"""The parts of the benchmark, with the headings of their tables."""

STEPS = 20_000  # steps of a controller in C that are timed


@checked
class Benchmark(OneGait):
    """Measure training throughput and the time of one action.

    Attributes:
        parts: What to measure: training beside bare physics, and actions of policies in Python and
            in C; both by default.
        updates: Number of updates in each timing.
        repeats: Number of timings; medians are reported.
        output: Folder of the results; runs/reproduce/benchmark by default.
    """

    title: ClassVar[str] = "reproduce benchmark"

    parts: tuple[Part, ...] = tuple(PARTS)
    updates: Count = 4
    repeats: Count = 5
    output: Path | None = None

    def run(self) -> None:
        robot = self.robot or DEFAULT_ROBOT
        folder = self.output or default_folder(self.title, load_robot(robot).name)
        refuse_run(folder)
        metrics: dict[str, Any] = {}
        for part in dict.fromkeys(self.parts):
            say(f"timing {part}")
            if part == "throughput":
                config = TrainingConfig(gait=self.gait, robot=robot)
                table = throughput(config, self.updates, self.repeats)
            else:
                table = action_times(self.policies())
            write_table(table, folder / part)
            print_table(PARTS[part], table)
            metrics[part] = json_records(table)
        write_metrics(metrics, folder / "metrics.json")
        console.print(f"written to {folder}")


def action_times(policies: Policies, steps: int = STEPS) -> pd.DataFrame:
    """Times an action of each policy in Python, and a whole control step in C if it compiles."""
    if not has_compiler():
        say("there is no C compiler here, cc: controllers in C are not timed")
    rows = []
    for kind, controller in policies.controllers([ALL]).items():
        n_observed = len(controller.policy.observation_names)
        observation = np.random.default_rng(0).normal(size=(1, n_observed))
        action = partial(controller.policy, observation)
        times = [_seconds(action) for _ in range(300)]
        row: dict[str, Any] = {"policy": kind}
        row["action in Python (µs)"] = round(1e6 * float(np.median(times)), 1)
        if has_compiler():
            row |= _step_times(policies.gait, controller, kind, steps)
        rows.append(row)
    return pd.DataFrame(rows)


def _step_times(gait: Gait, controller: Controller, kind: str, steps: int) -> dict[str, float]:
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
        # Use the fastest run, since other load of the machine only adds time.
        runs = [
            subprocess.run([folder / "step_times"], check=True, capture_output=True, text=True)
            for _ in range(5)
        ]
    median, late = min(tuple(map(float, run.stdout.split())) for run in runs)
    return {
        "step in C (µs)": median,
        "step in C, 99.9 % (µs)": late,
        "C file (kB)": round(size / 1000),
    }


def throughput(config: TrainingConfig, n_updates: int, repeats: int) -> pd.DataFrame:
    """Returns median rates (control steps/s) of PPO's updates, and of only Drake's physics for the
    same states and targets."""
    # Without MuJoCo's share, both time only Drake.
    config = replace(config, worlds=replace(config.worlds, mujoco_share=0.0))
    robot = load_robot(config.robot)
    stations = config.worlds.stations(robot, np.random.default_rng(config.seed))
    with tempfile.TemporaryDirectory() as temporary:
        run = TrainingRun(config, load_gait(config.gait), Path(temporary))
    physics, recorded = _BarePhysics(robot, stations), _record_steps(run)
    # The first update warms caches and is not timed.
    run.update()

    # Time both in turn, so that other load of the machine affects both equally.
    n_steps = n_updates * config.ppo.steps_per_update * config.n_robots
    seconds = []
    for _ in range(repeats):
        recorded.clear()
        training = _seconds(lambda: [run.update() for _ in range(n_updates)])
        seconds.append((training, _seconds(lambda: [physics.step(*pair) for pair in recorded])))
    rates = n_steps / np.array(seconds)
    training, bare = np.median(rates, axis=0)
    share = np.median(rates[:, 0] / rates[:, 1])
    rows = [
        (f"PPO training, {config.n_robots} robots", training, 1.0),
        ("BatchEvalUniquePeriodicDiscreteUpdate only, same states", bare, round(share, 2)),
    ]
    table = pd.DataFrame(rows, columns=pd.Index(["what", "control steps/s", "training is (share)"]))
    return table.round({"control steps/s": 0})


class _BarePhysics:
    """Calls only Drake's batch evaluation, for each group and control step."""

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
        rows = zip(np.array_split(states, n), np.array_split(desired, n), strict=True)
        for (diagram, context, n_steps), (group, inputs) in zip(self._groups, rows, strict=True):
            BatchEvalUniquePeriodicDiscreteUpdate(
                diagram,
                context,
                times=np.zeros(len(group)),
                states=group.T,
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
