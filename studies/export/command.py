"""`glassgait export`: writes a whole controller as one C file."""

import re
import tempfile
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import ClassVar

import pandas as pd

from glassgait.models.export.binding import LoadedController
from glassgait.models.export.controller import MOST_NAME, ControllerSource, write_controller
from glassgait.models.export.language import Real
from glassgait.models.export.reference import PythonController
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Count, Natural, Seed, Settings
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.console import console, say
from glassgait.studies.export.agreement import (
    compare_controllers,
    random_sequences,
    recorded_sequences,
)
from glassgait.studies.export.closed_loop import walk_both
from glassgait.studies.export.compiler import has_compiler, load_controller, write_source
from glassgait.studies.run_folder import open_run
from glassgait.studies.students.library import default_student, find_student
from glassgait.studies.tables import json_records, print_table, write_metrics, write_table

EXPERT = "expert"


@dataclass(frozen=True)
class Export(Settings):
    """Write a controller as one C file, from sensors to joint targets, and check it.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: `expert`, a kind of student, or path of a policy file; of the shipped formulas the
            shortest by default.
        precision: Type that the C file computes in.
        name: What the names of its files, functions and types begin with; <gait>_<policy> by
            default.
        n_steps: Control steps through which Python and C are compared, half of them of recorded
            and half of random sensors.
        n_robots: Robots that Python and C let walk for 20 s, in Drake and in MuJoCo; none by
            default.
        seed: Seed of all randomness.
        distillation: Folder of a distillation; runs/distillation/<gait> by default, and where that
            lacks the student, the shipped one.
        expert: Policy file of the expert, whose estimator observes; the shipped one by default.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/export/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "export"

    gait: str = "trot"
    policy: str | None = None
    precision: Real = "double"
    name: str | None = None
    n_steps: Count = 10_000
    n_robots: Natural = 0
    seed: Seed = 1000
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Writes the C file, and tables of what was measured."""
        gait = load_gait(self.gait)
        expert = load_expert(gait, self.expert)
        asked = self.policy or default_student(gait.name, self.distillation)
        policy = expert if asked == EXPERT else find_student(asked, expert, self.distillation)
        stem = Path(asked).stem
        written = write_controller(
            gait,
            policy,
            expert,
            name=self.name or controller_name(gait.name, stem),
            policy_name=stem,
            version=version("glassgait"),
            real=self.precision,
        )
        folder = self.output or Path("runs/export") / gait.name / stem
        inputs = {"gait": gait.digest(), "expert": expert.digest(), "policy": policy.digest()}
        with open_run(folder, study="export", settings=self, inputs=inputs, resume=self.resume):
            source = write_source(written, folder)
            self._check(gait, policy, expert, written, folder)
        console.print(f"written to {source} and {source.with_suffix('.h').name}")

    def _check(
        self,
        gait: Gait,
        policy: Policy,
        expert: NeuralPolicy,
        written: ControllerSource,
        folder: Path,
    ) -> None:
        metrics = {"bytes": len(written.source)}
        if not has_compiler():
            say("there is no C compiler here, cc: the file was not compared with Python")
            write_metrics(metrics, folder / "metrics.json")
            return
        with tempfile.TemporaryDirectory() as temporary:
            compiled = load_controller(written, Path(temporary))
            say(f"taking {self.n_steps} steps, in Python and in C")
            tables = {"agreement": self._agreement(gait, policy, expert, compiled)}
            if self.n_robots:
                say(f"{self.n_robots} robots walk, moved by Python and by C")
                tables["closed_loop"] = walk_both(
                    gait,
                    policy,
                    expert,
                    compiled,
                    n_robots=self.n_robots,
                    n_steps=EPISODE_STEPS,
                    seed=self.seed,
                )
        for title, table in tables.items():
            write_table(table, folder / title)
            print_table(f"{written.name}: {title.replace('_', ' ')}", table)
        records = {title: json_records(table) for title, table in tables.items()}
        write_metrics(metrics | records, folder / "metrics.json")

    def _agreement(
        self, gait: Gait, policy: Policy, expert: NeuralPolicy, compiled: LoadedController
    ) -> pd.DataFrame:
        python = PythonController(gait, policy, expert)
        recorded = (self.n_steps + 1) // 2
        sequences = {
            "recorded": recorded_sequences(gait, policy, expert, recorded, self.seed),
            "random": random_sequences(gait, self.n_steps - recorded, self.seed),
        }
        return pd.DataFrame(
            {"sensors": name, **asdict(compare_controllers(python, compiled, own))}
            for name, own in sequences.items()
        )


def controller_name(gait: str, policy: str) -> str:
    """Makes a name that C can take of those of a gait and a policy."""
    name = re.sub(r"[^a-z0-9]+", "_", f"{gait}_{policy}".lower())[:MOST_NAME].strip("_")
    return name if name[:1].isalpha() else f"gait_{name}"[:MOST_NAME]
