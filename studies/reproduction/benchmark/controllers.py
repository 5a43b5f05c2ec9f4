"""Time of one step of controllers in C, and their size."""

import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from glassgait.models.export.controller import ControllerSource, write_controller
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task.gait import Gait, load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.pages import page_template
from glassgait.studies.common.policies import EXPERT
from glassgait.studies.deployment.export.command import controller_name
from glassgait.studies.deployment.export.files import FLAGS, compile_c, write_source
from glassgait.studies.distillation.students.library import load_shipped_students
from glassgait.studies.reproduction.benchmark.timing import Times, fastest

COUNT = 20_000
"""Steps that are timed."""

GAITS = ("walk", "trot", "pace", "bound")
"""Gaits that a controller of several changes between."""


def shipped_policies(expert: NeuralPolicy) -> dict[str, Policy]:
    """Loads the expert and the shipped students of its gait, by kind."""
    return {EXPERT: expert, **load_shipped_students(expert)}


def controller_times(gait_name: str, count: int = COUNT) -> pd.DataFrame:
    """Times the controllers of a gait's shipped policies, compiled with the system's compiler.

    Args:
        gait_name: Name of a gait that ships.
        count: Steps that are timed, in each repetition.

    Returns:
        A row a policy: median and 99.9th percentile (µs) of the policy alone, of the estimator and
        of a whole step; size of the C file and of what it compiles to (kB); the machine's load.

    Raises:
        InputError: if there is no compiler.
    """
    gait, expert = load_gait(gait_name), load_expert(gait_name)
    rows = []
    for kind, policy in shipped_policies(expert).items():
        written = write_controller(
            gait,
            alone(policy, expert),
            name=controller_name(gait.name, kind),
            policy_name=kind,
            version=version("glassgait"),
        )
        rows.append({"policy": kind, **_measured(gait, written, count)})
    return pd.DataFrame(rows)


def switching_times(names: Sequence[str] = GAITS, count: int = COUNT) -> pd.DataFrame:
    """Times controllers of several gaits, which change the gait every 100 steps.

    Args:
        names: Names of gaits that ship.
        count: Steps that are timed, in each repetition.

    Returns:
        A row for each kind of policy that all these gaits have, as of `controller_times` without
        the parts of a step.

    Raises:
        InputError: if there is no compiler.
    """
    switch = GaitSwitch([load_gait(name) for name in names])
    experts = [load_expert(gait) for gait in switch.gaits]
    policies = [shipped_policies(expert) for expert in experts]
    rows = []
    for kind in policies[0]:
        if not all(kind in own for own in policies):
            continue
        controllers = [
            alone(expert) if kind == EXPERT else alone(own[kind], expert)
            for expert, own in zip(experts, policies, strict=True)
        ]
        written = write_controller(
            switch,
            alone(SwitchedPolicy(switch, controllers)),
            name=controller_name("_".join(names), kind),
            policy_name=kind,
            version=version("glassgait"),
        )
        rows.append({"policy": kind, **_measured(switch.gait, written, count)})
    return pd.DataFrame(rows)


def _measured(gait: Gait, written: ControllerSource, count: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        source = write_source(written, folder)
        compile_c(source, folder / "controller.o", (*FLAGS, "-c"))
        values = {
            "name": written.name,
            "real": written.real,
            "count": count,
            "speed": 0.5 * gait.max_speed,
            "dwell": gait.dwell[0],
            "takes_state": written.takes_state,
            "n_gaits": len(written.n_states),
        }
        program = compile_harness(folder, "controller_times.c", values)
        times, load = fastest(lambda: run_harness(program))
        timed = {
            part: {f"{part} (µs)": own.median, f"{part}, 99.9 % (µs)": own.late}
            for part, own in zip(("step", "estimator", "policy"), times, strict=False)
        }
        return {
            **timed.get("policy", {}),
            **timed.get("estimator", {}),
            **timed["step"],
            "C file (kB)": round(source.stat().st_size / 1000),
            "object file (kB)": round((folder / "controller.o").stat().st_size / 1000),
            "load": load,
        }


def compile_harness(
    folder: Path, name: str, values: Mapping[str, Any], objects: Sequence[Path] = ()
) -> Path:
    """Fills in a template of this study, and compiles it with objects that are there."""
    harness = folder / name
    template = page_template(Path(__file__).parent / "templates", name)
    write_atomically(harness, template.render(**values))
    program = harness.with_suffix("")
    compile_c(harness, program, (*FLAGS, *map(str, objects)))
    return program


def run_harness(program: Path) -> list[Times]:
    """Runs what times in C, and returns the times that it prints."""
    done = subprocess.run([program], check=True, capture_output=True, text=True, cwd=program.parent)
    return [Times(*map(float, line.split())) for line in done.stdout.splitlines()]
