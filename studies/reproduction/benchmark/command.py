"""`glassgait reproduce benchmark`: measures speed as ratios."""

import resource
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal

import pandas as pd

from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import DEFAULT_ROBOT
from glassgait.models.settings import Count
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.policies import EXPERT, OneGait, Policies, find_policies
from glassgait.studies.common.run_folder import (
    CONFIG_NAME,
    default_folder,
    read_settings,
    refuse_run,
)
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.registry import policy_title
from glassgait.studies.export.files import has_compiler
from glassgait.studies.reproduction.benchmark.controllers import controller_times, switching_times
from glassgait.studies.reproduction.benchmark.python_times import (
    action_times,
    compiled_against_library,
    expert_samples,
    peer_times,
    study_against_naive_loop,
)
from glassgait.studies.reproduction.benchmark.throughput import throughput
from glassgait.studies.training.config import TrainingConfig

Tables = dict[str, tuple[str, pd.DataFrame]]
"""What was measured: for each file of a table, its title and the table."""

Part = Literal["throughput", "inference", "controllers", "gaits", "students"]
"""What can be measured."""

PARTS: tuple[Part, ...] = ("throughput", "inference", "controllers", "gaits", "students")

IN_C = {
    "controllers": "controllers in C, and the same policies in Python",
    "gaits": "controllers of several gaits in C",
}
"""Parts that need a C compiler, and what they time."""

GAITS = ("walk", "trot", "pace", "bound")
"""Gaits that a controller of several changes between."""


@dataclass(frozen=True)
class Benchmark(OneGait):
    """Measure training throughput and the time of one action, as ratios.

    Attributes:
        parts: What is measured: training, actions in Python, controllers in C beside Python and
            ONNX Runtime, controllers in C of walk, trot, pace and bound together, students beside
            their libraries; all by default.
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

    @cached_property
    def _found(self) -> Policies:
        return self.policies()

    def run(self) -> None:
        """Measures, and writes tables."""
        robot = load_robot(self.robot or DEFAULT_ROBOT)
        folder = self.output or default_folder(self.title, robot.name)
        refuse_run(folder)
        measures = {
            "throughput": self._throughput,
            "inference": self._inference,
            "controllers": self._controllers,
            "gaits": self._gaits,
            "students": self._students,
        }
        metrics: dict[str, Any] = {}
        for part in dict.fromkeys(self.parts):
            if part in IN_C and not has_compiler():
                say(f"there is no C compiler here, cc: {IN_C[part]} are not timed")
                continue
            say(f"timing {IN_C.get(part, part)}")
            for title, (heading, table) in measures[part]().items():
                write_table(table, folder / title)
                print_table(heading, table)
                metrics[title] = json_records(table)
        # Linux counts in KiB.
        metrics["peak_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 2**10
        write_metrics(metrics, folder / "metrics.json")
        console.print(f"written to {folder}")

    def _throughput(self) -> Tables:
        config = TrainingConfig(gait=self.gait, robot=self.robot or DEFAULT_ROBOT)
        if self.training is not None:
            settings = read_settings(self.training, "train")
            config = TrainingConfig.from_plain(settings, str(self.training / CONFIG_NAME))
        table = throughput(config, self.training, self.updates, self.repeats, self.gym_steps)
        return {"throughput": ("Throughput (2 cores unless your machine has more)", table)}

    def _inference(self) -> Tables:
        found = {EXPERT: self._found.expert, **self._found.students}
        table = action_times({policy_title(kind): policy for kind, policy in found.items()})
        return {"inference": ("One action, one observation", table)}

    def _controllers(self) -> Tables:
        return {
            "controllers": ("Controllers in C, one step", controller_times(self._found)),
            "peers": ("The same policies elsewhere, one action", peer_times(self._found)),
        }

    def _gaits(self) -> Tables:
        several = [find_policies(load_gait(name), robot=self.robot) for name in GAITS]
        return {"gaits": ("Controllers of several gaits in C, one step", switching_times(several))}

    def _students(self) -> Tables:
        """Times students beside their libraries' models, which are fitted for it."""
        found = self._found
        samples = expert_samples(found.expert, n_steps=1000)
        config = DistillationConfig(gait=self.gait)
        compiled = compiled_against_library(samples, found.expert, config.settings)
        tables = {"compiled": ("Compiled students against their libraries", compiled)}
        folder = self.source or found.output("distillation")
        naive = study_against_naive_loop(samples, config, folder)
        if len(naive):
            tables["distillation"] = ("The distillation study against the naive loop", naive)
        return tables
