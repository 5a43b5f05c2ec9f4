"""`glassgait export`: writes a whole controller as one C file, or its policy as ONNX."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from glassgait.models.errors import InputError
from glassgait.models.export.controller import MOST_NAME
from glassgait.models.export.language import Real
from glassgait.models.policies.library import load_expert
from glassgait.models.settings import Count, Natural, Seed, Settings
from glassgait.models.task.gait import load_gait
from glassgait.studies.console import console
from glassgait.studies.export.c_file import CFile
from glassgait.studies.export.exported import Acting, Effort, Exported
from glassgait.studies.run_folder import open_run
from glassgait.studies.students.library import default_student, find_student
from glassgait.studies.tables import json_records, print_table, write_metrics, write_table

EXPERT = "expert"


@dataclass(frozen=True)
class Export(Settings):
    """Write a controller as one C file, or its policy as ONNX, and check it against Python.

    Attributes:
        gait: Name of a gait, or path of a gait file.
        policy: `expert`, a kind of student, or path of a policy file; of the shipped formulas the
            shortest by default.
        format: `c` is all from sensors to joint targets, `onnx` the estimator and the policy, which
            `pip install 'glassgait[onnx]'` is for.
        precision: Type that the C file computes in, or that the ONNX file reads and gives.
        name: What the names of its files, functions and types begin with; <gait>_<policy> by
            default.
        n_steps: Control steps through which Python and the export are compared, half of them of
            recorded and half of random sensors.
        n_robots: Robots that Python and the export let walk for 20 s, in Drake and in MuJoCo; none
            by default.
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
    format: Literal["c", "onnx"] = "c"
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
        """Writes the files, and tables of what was measured."""
        gait = load_gait(self.gait)
        expert = load_expert(gait, self.expert)
        asked = self.policy or default_student(gait.name, self.distillation)
        policy = expert if asked == EXPERT else find_student(asked, expert, self.distillation)
        stem = Path(asked).stem
        name = self.name or controller_name(gait.name, stem)
        exported = self._exported(Acting(gait, policy, expert, name, stem))
        folder = self.output or Path("runs/export") / gait.name / stem
        inputs = {"gait": gait.digest(), "expert": expert.digest(), "policy": policy.digest()}
        with open_run(folder, study="export", settings=self, inputs=inputs, resume=self.resume):
            tables = exported.check(Effort(self.n_steps, self.n_robots, self.seed))
            first, *others = exported.write(folder)
            for title, table in tables.items():
                write_table(table, folder / title)
                print_table(f"{name}: {title.replace('_', ' ')}", table)
            records = {title: json_records(table) for title, table in tables.items()}
            write_metrics({"bytes": first.stat().st_size} | records, folder / "metrics.json")
        console.print(f"written to {' and '.join([str(first), *(own.name for own in others)])}")

    def _exported(self, acting: Acting) -> Exported:
        if self.format == "c":
            return CFile(acting, self.precision)
        try:
            # Imported here: ONNX and its runtime are an extra.
            from glassgait.studies.export.onnx_file import OnnxFile  # noqa: PLC0415
        except ImportError as error:
            raise InputError(
                "--format onnx: ONNX is not installed; run pip install 'glassgait[onnx]'"
            ) from error
        return OnnxFile(acting, self.precision)


def controller_name(gait: str, policy: str) -> str:
    """Makes a name that C can take of those of a gait and a policy."""
    name = re.sub(r"[^a-z0-9]+", "_", f"{gait}_{policy}".lower())[:MOST_NAME].strip("_")
    return name if name[:1].isalpha() else f"gait_{name}"[:MOST_NAME]
