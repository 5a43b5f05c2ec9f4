"""`glassgait reproduce benchmark`: measures speed as ratios."""

import resource
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pandas as pd

from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.library import load_expert, load_policy, load_student, policy_path
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Count, Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.run_folder import CONFIG_NAME, read_settings, refuse_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.deployment.export.files import has_compiler
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.boosting import GBM
from glassgait.studies.distillation.students.library import distillation_folder
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.reproduction.benchmark.controllers import controller_times, switching_times
from glassgait.studies.reproduction.benchmark.python_times import (
    compiled_against_library,
    expert_samples,
    observed,
    peer_times,
    single_row_microseconds,
    study_against_naive_loop,
)
from glassgait.studies.reproduction.benchmark.throughput import (
    gymnasium_processes,
    training_and_physics,
)
from glassgait.studies.training.config import TrainingConfig

Tables = dict[str, tuple[str, pd.DataFrame]]
"""What was measured: for each file of a table, its title and the table."""

Part = Literal["throughput", "inference", "controllers", "gaits", "trees", "students"]
"""What can be measured."""

PARTS: tuple[Part, ...] = ("throughput", "inference", "controllers", "gaits", "trees", "students")


@dataclass(frozen=True)
class Benchmark(Settings):
    """Measure training throughput and the time of one action, as ratios.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        parts: What is measured: training, actions in Python, controllers in C beside Python and
            ONNX Runtime, controllers in C of walk, trot, pace and bound together, trees in C beside
            tl2cgen's, students beside their libraries; all by default.
        training: Folder of a training run to continue in memory, so that robots walk rather than
            fall; from the beginning by default.
        updates: Updates that are timed at once.
        repeats: Number of timings; medians are reported.
        gym_steps: Steps of gymnasium's sixteen environments.
        source: Folder of a distillation; runs/distillation/<gait> by default.
        output: Folder of the results.
    """

    title: ClassVar[str] = "benchmark"

    gait: str = "trot"
    parts: tuple[Part, ...] = PARTS
    training: Path | None = None
    updates: Count = 4
    repeats: Count = 5
    gym_steps: Count = 200
    source: Path | None = None
    output: Path = Path("runs/benchmark")

    def run(self) -> None:
        """Measures, and writes tables."""
        refuse_run(self.output)
        measures = {
            "throughput": self._throughput,
            "inference": self._inference,
            "controllers": self._controllers,
            "gaits": self._gaits,
            "trees": self._trees,
            "students": self._students,
        }
        metrics: dict[str, Any] = {}
        for part in dict.fromkeys(self.parts):
            for title, (heading, table) in measures[part]().items():
                write_table(table, self.output / title)
                print_table(heading, table)
                metrics[title] = json_records(table)
        # Linux counts in KiB.
        metrics["peak_memory_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 2**10
        write_metrics(metrics, self.output / "metrics.json")
        console.print(f"written to {self.output}")

    def _controllers(self) -> Tables:
        if not has_compiler():
            say("there is no C compiler here, cc: controllers in C are not timed")
            return {}
        say("timing controllers in C, and the same policies in Python")
        return {
            "controllers": ("Controllers in C, one step", controller_times(self.gait)),
            "peers": ("The same policies elsewhere, one action", peer_times(self.gait)),
        }

    def _gaits(self) -> Tables:
        if not has_compiler():
            say("there is no C compiler here, cc: controllers of several gaits are not timed")
            return {}
        say("timing controllers of several gaits in C")
        return {"gaits": ("Controllers of several gaits in C, one step", switching_times())}

    def _trees(self) -> Tables:
        if not has_compiler():
            say("there is no C compiler here, cc: trees in C are not timed")
            return {}
        try:
            # Imported here: tl2cgen and treelite are an extra.
            from glassgait.studies.reproduction.benchmark.compiled_trees import tree_times  # noqa: PLC0415
        except ImportError:
            say("trees by tl2cgen are not timed: run pip install 'glassgait[tl2cgen]'")
            return {}
        gait, expert = load_gait(self.gait), load_expert(self.gait)
        trees = load_student(self.gait, GBM.name)
        if not isinstance(trees, BoostedTreesPolicy):
            return {}
        say("compiling trees by tl2cgen, which takes minutes")
        table = tree_times(gait, trees, expert, observed(gait, expert))
        return {"trees": ("GBM in C, one action", table)}

    def _students(self) -> Tables:
        say("fitting library models, to compare them with what they compile to")
        expert = load_expert(self.gait)
        samples = expert_samples(expert, n_steps=1000)
        config = DistillationConfig(gait=self.gait)
        compiled = compiled_against_library(samples, expert, config.settings)
        tables = {"compiled": ("Compiled students against their libraries", compiled)}
        naive = study_against_naive_loop(samples, config, self._student_folder())
        if len(naive):
            tables["distillation"] = ("The distillation study against the naive loop", naive)
        return tables

    def _throughput(self) -> Tables:
        config = TrainingConfig(gait=self.gait)
        if self.training is not None:
            settings = read_settings(self.training, "train")
            config = TrainingConfig.from_plain(settings, str(self.training / CONFIG_NAME))
        say("timing training and bare physics in turn")
        pairs = pd.DataFrame(
            training_and_physics(config, self.training, self.updates, self.repeats)
        )
        say("timing gymnasium's AsyncVectorEnv of DrakeGymEnv, 16 environments")
        processes = gymnasium_processes(16, self.gym_steps)
        speeds = pairs.median()
        training = speeds["training"]
        shares = [
            (pairs["training"] / pairs[name]).median() for name in ("late_physics", "physics")
        ]
        table = pd.DataFrame(
            {
                "what": [
                    f"PPO training, {config.n_robots} robots",
                    "its physics alone, latencies included",
                    "bare BatchEvalUniquePeriodicDiscreteUpdate, same states and targets",
                    "AsyncVectorEnv of 16 DrakeGymEnv over the diagram, no learning",
                ],
                "control steps/s": [*map(round, speeds), round(processes)],
                "training is": [
                    "1",
                    *(f"{share:.2f} of it" for share in shares),
                    f"{training / processes:.1f} times it",
                ],
            }
        )
        return {"throughput": ("Throughput (2 cores unless your machine has more)", table)}

    def _student_folder(self) -> Path:
        return self.source or distillation_folder(self.gait)

    def _inference(self) -> Tables:
        expert = load_expert(self.gait)
        policies: dict[str, Policy] = {"neural expert": expert}
        folder = self._student_folder()
        for kind, student in STUDENTS.items():
            path = policy_path(folder, kind)
            if path.exists():
                policies[student.title] = load_policy(path)
        observation = np.random.default_rng(0).normal(size=len(expert.observation_names))
        times = {
            title: single_row_microseconds(policy, observation)
            for title, policy in policies.items()
        }
        table = pd.DataFrame(
            {"policy": times.keys(), "12 joints (µs)": [round(t, 1) for t in times.values()]}
        )
        return {"inference": ("One action, one observation", table)}
