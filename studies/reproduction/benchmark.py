"""`glassgait reproduce benchmark`: measures the time of one action."""

import subprocess
import tempfile
import timeit
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
from glassgait.models.settings import checked
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import OneGait
from glassgait.studies.common.figures import page_template
from glassgait.studies.common.policies import ALL, Policies
from glassgait.studies.common.run import default_folder, refuse_run
from glassgait.studies.common.tables import print_table, write_table
from glassgait.studies.export.command import controller_name
from glassgait.studies.reproduction.page import TEMPLATES

STEPS = 20_000  # steps of a controller in C that are timed


@checked
class Benchmark(OneGait):
    """Measure the time of one action of each policy, in Python and in C.

    Attributes:
        output: Folder of the results; runs/reproduce/benchmark by default.
    """

    title: ClassVar[str] = "reproduce benchmark"

    output: Path | None = None

    def run(self) -> None:
        """Measures, and writes the table."""
        found = self.policies()
        folder = self.output or default_folder(self.title, found.robot.name)
        refuse_run(folder)
        table = action_times(found)
        write_table(table, folder / "actions")
        print_table("One action, one robot", table)
        console.print(f"written to {folder}")


def action_times(found: Policies) -> pd.DataFrame:
    """Times an action of each policy in Python, and a whole control step in C if it compiles."""
    if not has_compiler():
        say("there is no C compiler here, cc: controllers in C are not timed")
    rows = []
    for kind, controller in found.controllers([ALL]).items():
        n_observed = len(controller.policy.observation_names)
        observation = np.random.default_rng(0).normal(size=(1, n_observed))
        times = timeit.repeat(partial(controller.policy, observation), repeat=300, number=1)
        row: dict[str, Any] = {"policy": kind}
        row["action in Python (µs)"] = round(1e6 * float(np.median(times)), 1)
        if has_compiler():
            row |= _step_times(found.gait, controller, kind)
        rows.append(row)
    return pd.DataFrame(rows)


def _step_times(gait: Gait, controller: Controller, kind: str) -> dict[str, float]:
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
            count=STEPS,
            speed=0.5 * gait.max_speed,
            dwell=gait.dwell[0],
            has_imu=written.has_imu,
        )
        write_atomically(folder / "step_times.c", harness)
        compile_c(folder / "step_times.c", folder / "step_times", FLAGS)
        # The fastest run counts: other work of the machine only adds time.
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
