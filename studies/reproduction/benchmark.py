"""`glassgait reproduce benchmark`: measures training throughput and the time of one action."""

import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.export.binding import FLAGS, compile_c, has_compiler, write_source
from glassgait.models.export.c_source import write_controller
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.settings import Count, checked
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import OneGait
from glassgait.studies.common.pages import page_template
from glassgait.studies.common.policies import ALL, Policies
from glassgait.studies.common.run import CONFIG_NAME, default_folder, read_run, refuse_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.boosting import EnsembleSettings, fit_models
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.config import StudentsSettings
from glassgait.studies.distillation.dataset import Dataset
from glassgait.studies.distillation.students import policy_title
from glassgait.studies.export.command import controller_name
from glassgait.studies.reproduction.page import TEMPLATES
from glassgait.studies.reproduction.throughput import throughput
from glassgait.studies.training.config import TrainingConfig

Part = Literal["throughput", "actions", "students"]

PARTS: tuple[Part, ...] = ("throughput", "actions", "students")

STEPS = 20_000
"""Steps of a controller in C that are timed."""

CALLS = 300
"""Calls in Python that are timed."""

REPETITIONS = 5
"""Repetitions, of which the fastest is reported: the machine does other work too."""


@checked
class Benchmark(OneGait):
    """Measure training throughput and the time of one action, as ratios.

    Attributes:
        parts: What to measure: training, actions of policies in Python and in C, students beside
            the models of their libraries; all by default.
        training: Folder of a training run to continue in memory, so that robots walk rather than
            fall; from the beginning by default.
        updates: Updates that are timed at once.
        repeats: Number of timings; medians are reported.
        gym_steps: Steps of gymnasium's sixteen environments.
        output: Folder of the results; runs/reproduce/benchmark by default.
    """

    title: ClassVar[str] = "reproduce benchmark"

    parts: tuple[Part, ...] = PARTS
    training: Path | None = None
    updates: Count = 4
    repeats: Count = 5
    gym_steps: Count = 200
    output: Path | None = None

    def run(self) -> None:
        """Measures, and writes tables."""
        robot = load_robot(self.robot or DEFAULT_ROBOT)
        folder = self.output or default_folder(self.title, robot.name)
        refuse_run(folder)
        measures: dict[str, tuple[str, Callable[[], pd.DataFrame]]] = {
            "throughput": ("Throughput", self._throughput),
            "actions": ("One action, one robot", lambda: action_times(self.policies())),
            "students": ("Students beside their libraries' models", self._students),
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
        return throughput(config, self.training, self.updates, self.repeats, self.gym_steps)

    def _students(self) -> pd.DataFrame:
        found = self.policies()
        return library_times(expert_samples(found, n_steps=1000), found, StudentsSettings())


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


def step_times(
    gait: Gait, controller: AlternatingController, kind: str, steps: int
) -> dict[str, float]:
    """Compiles a controller, and times its step on random sensors, several times."""
    written = write_controller(
        gait,
        controller,
        name=controller_name(gait.name, kind),
        policy_name=kind,
        version=version("glassgait"),
    )
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


def expert_samples(found: Policies, n_steps: int) -> Dataset:
    """Collects four episodes of the expert alone."""
    return collect(
        found.gait,
        alone(found.expert),
        episodes=range(1, 5),
        n_steps=n_steps,
        worlds=Scenario(),
        generator=np.random.default_rng(0),
    )


def library_times(samples: Dataset, found: Policies, settings: StudentsSettings) -> pd.DataFrame:
    """Times an action of all 12 joints: compiled, and `predict` of the library joint by joint.

    Boosted trees are as many and as deep as the study's; additive models have as many terms, but
    few rounds, which a prediction does not notice.
    """
    gait, expert = found.gait, found.expert
    few = replace(settings.of("ebm"), outer_bags=1, max_rounds=50)
    settings = replace(settings, **{"ebm": few})
    training_set = samples.training_set(gait, expert)
    rows = []
    for kind in ("gbm", "histogram_gbm", "ebm"):
        fitted: EnsembleSettings = getattr(settings, kind)
        models = fit_models(training_set, fitted, seed=0, n_jobs=2)
        compiled = fitted.policy.compile(expert.gait, expert.observation_names, models)

        def library(observations: Array, models: Any = models) -> Array:
            return np.stack([model.predict(observations) for model in models], axis=1)

        row = samples.observations[:1]
        ours, theirs = call_time(compiled, row), call_time(library, row)
        error = compiled(samples.observations) - library(samples.observations)
        rows.append(
            {
                "student": kind,
                "compiled (µs)": round(ours, 1),
                "predict × 12 (µs)": round(theirs),
                "ratio": round(theirs / ours),
                "greatest difference": float(np.abs(error).max()),
            }
        )
    return pd.DataFrame(rows)
