"""`glassgait reproduce benchmark`: measures training throughput and the time of one action."""

import subprocess
import tempfile
import timeit
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from glassgait.models.export.binding import FLAGS, compile_c, has_compiler, write_source
from glassgait.models.export.c_source import write_controller
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import Controller
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.settings import Count, checked
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

STEPS = 20_000  # steps of a controller in C that are timed


@checked
class Benchmark(OneGait):
    """Measure training throughput and the time of one action.

    Attributes:
        updates: Number of updates in each timing.
        repeats: Number of timings; medians are reported.
        output: Folder of the results; runs/reproduce/benchmark by default.
    """

    title: ClassVar[str] = "reproduce benchmark"

    updates: Count = 4
    repeats: Count = 5
    output: Path | None = None

    def run(self) -> None:
        robot = self.robot or DEFAULT_ROBOT
        folder = self.output or default_folder(self.title, load_robot(robot).name)
        refuse_run(folder)
        say("timing training, then actions")
        config = TrainingConfig(gait=self.gait, robot=robot)
        tables = {
            "throughput": throughput(config, self.updates, self.repeats),
            "actions": action_times(self.policies()),
        }
        for part, table in tables.items():
            write_table(table, folder / part)
            print_table(part.capitalize(), table)
        metrics = {part: json_records(table) for part, table in tables.items()}
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
        times = timeit.repeat(action, number=1, repeat=300)
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
    """Returns the median rate (control steps/s) of PPO's updates, with physics in Drake."""
    config = replace(config, worlds=replace(config.worlds, mujoco_share=0.0))
    with tempfile.TemporaryDirectory() as temporary:
        run = TrainingRun(config, load_gait(config.gait), Path(temporary))
    # The first update warms caches and is not timed.
    run.update()
    times = timeit.repeat(run.update, number=n_updates, repeat=repeats)
    rate = n_updates * config.steps_per_update / float(np.median(times))
    what = f"PPO training, {config.n_robots} robots"
    return pd.DataFrame([{"what": what, "control steps/s": round(rate)}])
