"""`glassgait export`: writes a whole controller as one C file, or a network as ONNX."""

import re
import tempfile
from importlib.metadata import version
from pathlib import Path
from typing import ClassVar, Literal

import pandas as pd

from glassgait.models.errors import InputError
from glassgait.models.export.binding import has_compiler, load_controller, write_source
from glassgait.models.export.c_language import Real
from glassgait.models.export.c_source import MOST_NAME, check_name, write_controller
from glassgait.models.export.contract import CONTRACT, contract_of, contract_text
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import Controller
from glassgait.models.settings import Count, Seed, checked
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import console, say
from glassgait.studies.common.experiment import REPORTED_SEEDS, OneGait
from glassgait.studies.common.run import open_run
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students import default_student
from glassgait.studies.export.agreement import agreement_table

Written = tuple[list[Path], dict[str, pd.DataFrame]]
"""Files of an export, the most important one first, and tables of its comparison with Python."""


@checked
class Export(OneGait):
    """Write a controller as one C file, or a network as ONNX, and check it against Python.

    Attributes:
        policy: `expert`, a kind of student, or path of a policy file; by default `formulas`,
            otherwise the shortest student whose actions are sums of terms.
        format: `c` is the whole controller, from sensors to joint targets. `onnx` is a network and
            its estimator; it needs `pip install 'glassgait[onnx]'`.
        precision: Type of the C file's arithmetic, or of the ONNX file's inputs and outputs.
        name: Prefix of the names of files, functions and types; <gait>_<policy> by default.
        n_steps: Control steps of the comparison with Python; for C, half with recorded and half
            with random sensors.
        output: Folder of the results; runs/export/<gait>/<policy> by default.
    """

    title: ClassVar[str] = "export"

    policy: str | None = None
    format: Literal["c", "onnx"] = "c"
    precision: Real = "double"
    name: str | None = None
    n_steps: Count = 10_000
    seed: Seed = REPORTED_SEEDS[0]
    output: Path | None = None

    def run(self) -> None:
        # Load the policy, and name its files.
        policies = self.policies()
        gait, selected = policies.gait, self.policy or default_student(policies)
        controller, policy_name = policies.controller(selected), Path(selected).stem
        name = self.name or controller_name(gait.name, policy_name)
        check_name(name)
        folder = self.output or policies.output(self.title) / policy_name
        inputs = {
            "gait": gait.digest(),
            "expert": controller.expert.digest(),
            "policy": controller.policy.digest(),
        }

        # Write the files, their contract, and the tables of the comparison with Python.
        with open_run(folder, study=self.title, settings=self, inputs=inputs):
            stem = folder / name
            if self.format == "c":
                files, tables = self._write_c(gait, controller, stem, policy_name)
            else:
                files, tables = self._write_onnx(gait, controller, stem)
            contract = contract_of(gait, controller, files[0], policy_name, self.precision)
            files.append(folder / CONTRACT)
            write_atomically(files[-1], contract_text(contract))
            for title, table in tables.items():
                write_table(table, folder / title)
                print_table(f"{name}: {title.replace('_', ' ')}", table)
            records = {title: json_records(table) for title, table in tables.items()}
            write_metrics({"bytes": files[0].stat().st_size} | records, folder / "metrics.json")
        console.print(f"written to {', '.join([str(files[0]), *(f.name for f in files[1:])])}")

    def _write_c(self, gait: Gait, controller: Controller, stem: Path, policy_name: str) -> Written:
        names = {"name": stem.name, "policy_name": policy_name, "version": version("glassgait")}
        written = write_controller(gait, controller, **names, real=self.precision)
        # Compare with Python first, so that a file that differs is not written.
        tables: dict[str, pd.DataFrame] = {}
        if not has_compiler():
            say("there is no C compiler here, cc: the file was not compared with Python")
        else:
            with tempfile.TemporaryDirectory() as temporary:
                compiled = load_controller(written, Path(temporary))
                say(f"taking {self.n_steps} steps, in Python and in C")
                exact = self.precision == "double"
                tables["agreement"] = agreement_table(
                    gait, controller, compiled, self.n_steps, self.seed, exact=exact
                )
        source = write_source(written, stem.parent)
        return [source, source.with_suffix(".h")], tables

    def _write_onnx(self, gait: Gait, controller: Controller, stem: Path) -> Written:
        try:
            # Imported here: ONNX and its runtime are an extra.
            from glassgait.studies.export import onnx_network  # noqa: PLC0415
        except ImportError as error:
            raise InputError(
                "--format onnx: ONNX is not installed; run pip install 'glassgait[onnx]'"
            ) from error
        model = onnx_network.graph_bytes(gait, controller, version("glassgait"), self.precision)
        say(f"acting on {self.n_steps} observations, in Python and by ONNX Runtime")
        table = onnx_network.compare_graph(model, gait, controller, self.n_steps, self.seed)
        path = stem.with_name(f"{stem.name}.onnx")
        write_atomically(path, model)
        return [path], {"agreement": table}


def controller_name(gait: str, policy: str) -> str:
    name = re.sub(r"[^a-z0-9]+", "_", f"{gait}_{policy}".lower())[:MOST_NAME].strip("_")
    return name if name[:1].isalpha() else f"gait_{name}"[:MOST_NAME]
