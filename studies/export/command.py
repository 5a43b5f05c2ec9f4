"""`glassgait export`: writes a whole controller as one C file, or its policy as ONNX."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, Literal

from glassgait.models.errors import InputError
from glassgait.models.export.controller import MOST_NAME
from glassgait.models.export.language import Real
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import find_gait
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.settings import Count, Natural, Seed, checked
from glassgait.models.task.day import load_day
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.console import console
from glassgait.studies.common.policies import Policies, PolicySource, find_policies_of
from glassgait.studies.common.rollouts import REPORTED_SEEDS
from glassgait.studies.common.run_folder import default_folder, open_run
from glassgait.studies.common.sweep import Gaits, gaits_named
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import default_student
from glassgait.studies.export.files import CFile, Deployment, Effort, Exported


@checked
class Export(PolicySource):
    """Write a controller as one C file, or its policy as ONNX, and check it against Python.

    Attributes:
        gait: Name of a gait, or path of a gait file. Of several the first runs, and the controller
            changes to another on request while the robot walks; with --format c, and with the
            expert or a kind of students that every gait has.
        policy: `expert`, a kind of student, or path of a policy file; of the shipped formulas the
            shortest by default.
        day: Of a C file, the robot's day, in some of whose modes the policy acts: `day`, which
            ships, or path of a day's file; by default the policy always acts.
        format: `c` is all from sensors to joint targets, `onnx` the estimator and the policy, which
            `pip install 'glassgait[onnx]'` is for.
        precision: Type that the C file computes in, or that the ONNX file reads and gives.
        name: What the names of its files, functions and types begin with; <gait>_<policy> by
            default, of several gaits <gait>_<gait>_<policy>.
        n_steps: Control steps through which Python and the export are compared, half of them of
            recorded and half of random sensors.
        n_robots: Robots that Python and the export let walk for 20 s, in Drake and in MuJoCo, of
            several gaits with another one every 3 s; none by default.
        seed: Seed of all randomness.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/export/<gait>/<policy> by default, of several gaits
            runs/export/<gait>_<gait>/<policy>.
    """

    title: ClassVar[str] = "export"

    gait: Gaits = ("trot",)
    policy: str | None = None
    day: str | None = None
    format: Literal["c", "onnx"] = "c"
    precision: Real = "double"
    name: str | None = None
    n_steps: Count = 10_000
    n_robots: Natural = 0
    seed: Seed = REPORTED_SEEDS[0]
    resume: bool = False
    output: Path | None = None

    def __post_init__(self) -> None:
        if len(self.gait) > 1 and self.format == "onnx":
            raise InputError(
                "export: an ONNX file holds the policy of one gait; name one with --gait, or give "
                "--format c"
            )

        if self.day is not None and self.format == "onnx":
            raise InputError(
                "export: an ONNX file holds a policy alone, and no day; leave --day out, or give "
                "--format c"
            )
        if self.day is not None and self.n_robots:
            raise InputError(
                "export: robots of a day do not only walk, as those of --n-robots do; leave one of "
                "them out"
            )

    def run(self) -> None:
        """Writes the files, and tables of what was measured."""
        gaits = [find_gait(name, self.robot) for name in gaits_named(self.gait)]
        found = list(find_policies_of(gaits, self.source, [self.policy or ""], self.robot).values())
        asked = self.policy or default_student(found[0])
        deployment, inputs = self._deployment(found, asked)
        exported = self._exported(deployment)
        title = Path("_".join(gait.name for gait in gaits)) / deployment.policy_name
        folder = default_folder(self.title, found[0].robot.name)
        folder = self.output or folder / title
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run):
            tables = exported.check(Effort(self.n_steps, self.n_robots, self.seed))
            first, *others = exported.write_all(folder)
            for title, table in tables.items():
                write_table(table, folder / title)
                print_table(f"{deployment.name}: {title.replace('_', ' ')}", table)
            records = {title: json_records(table) for title, table in tables.items()}
            write_metrics({"bytes": first.stat().st_size} | records, folder / "metrics.json")
        console.print(f"written to {', '.join([str(first), *(own.name for own in others)])}")

    def _deployment(
        self, found: Sequence[Policies], asked: str
    ) -> tuple[Deployment, dict[str, str]]:
        """Returns what is exported, and digests of what it is made of."""
        controllers = [own.controller(asked) for own in found]
        if len(found) > 1:
            gait = GaitSwitch([own.gait for own in found])
            controller = alone(SwitchedPolicy(gait, controllers))
            inputs = {"gait": gait.gait.digest(), "policy": controller.policy.digest()}
        else:
            (gait,), (controller,) = (own.gait for own in found), controllers
            expert, policy = controller.expert.digest(), controller.policy.digest()
            inputs = {"gait": gait.digest(), "expert": expert, "policy": policy}
        policy_name = Path(asked).stem
        gaits = "_".join(own.gait.name for own in found)
        name = self.name or controller_name(gaits, policy_name)
        day = None if self.day is None else load_day(self.day)
        inputs |= {} if day is None else {"day": day.digest()}
        return Deployment(gait, controller, name, policy_name, day), inputs

    def _exported(self, deployment: Deployment) -> Exported:
        if self.format == "c":
            return CFile(deployment, self.precision)
        try:
            # Imported here: ONNX and its runtime are an extra.
            from glassgait.studies.export.onnx_file import OnnxFile  # noqa: PLC0415
        except ImportError as error:
            raise InputError(
                "--format onnx: ONNX is not installed; run pip install 'glassgait[onnx]'"
            ) from error
        return OnnxFile(deployment, self.precision)


def controller_name(gait: str, policy: str) -> str:
    """Makes a name that C can take of those of a gait and a policy."""
    name = re.sub(r"[^a-z0-9]+", "_", f"{gait}_{policy}".lower())[:MOST_NAME].strip("_")
    return name if name[:1].isalpha() else f"gait_{name}"[:MOST_NAME]
