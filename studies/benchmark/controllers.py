"""Time of one step of controllers in C, and their size."""

import subprocess
import tempfile
from importlib.metadata import version
from pathlib import Path

import pandas as pd

from glassgait.models.export.controller import ControllerSource, write_controller
from glassgait.models.files import write_atomically
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.export.command import EXPERT, controller_name
from glassgait.studies.export.compiler import FLAGS, compile_c, write_source
from glassgait.studies.pages import page_template
from glassgait.studies.students.library import load_shipped_students

COUNT = 20_000
"""Steps that are timed."""


def controller_times(gait_name: str, count: int = COUNT) -> pd.DataFrame:
    """Times the controllers of a gait's shipped policies, compiled with the system's compiler.

    Args:
        gait_name: Name of a gait that ships.
        count: Steps that are timed.

    Returns:
        A row a policy: medians (µs) of the policy alone, of the estimator and of a whole step; the
        99.9th percentile of a step by the thread's own clock (µs), which other work on the machine
        does not count for; size of the C file and of what it compiles to (kB).

    Raises:
        InputError: if there is no compiler.
    """
    gait, expert = load_gait(gait_name), load_expert(gait_name)
    policies: dict[str, Policy] = {EXPERT: expert, **load_shipped_students(expert)}
    rows = []
    for kind, policy in policies.items():
        written = write_controller(
            gait,
            policy,
            expert,
            name=controller_name(gait.name, kind),
            policy_name=kind,
            version=version("glassgait"),
        )
        rows.append({"policy": kind, **_measured(gait, written, count)})
    return pd.DataFrame(rows)


def _measured(gait: Gait, written: ControllerSource, count: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        source = write_source(written, folder)
        compile_c(source, folder / "controller.o", (*FLAGS, "-c"))
        harness = folder / "controller_times.c"
        template = page_template(Path(__file__).parent / "templates", harness.name)
        text = template.render(
            name=written.name,
            real=written.real,
            count=count,
            speed=0.5 * gait.max_speed,
            dwell=gait.dwell[0],
            takes_state=written.takes_state,
        )
        write_atomically(harness, text)
        compile_c(harness, folder / "controller_times")
        done = subprocess.run(
            [folder / "controller_times"], check=True, capture_output=True, text=True
        )
        (step, worst), (estimator, _), (policy, _) = (
            map(float, line.split()) for line in done.stdout.splitlines()
        )
        return {
            "policy (µs)": policy,
            "estimator (µs)": estimator,
            "step (µs)": step,
            "step, 99.9 % (µs)": worst,
            "C file (kB)": round(source.stat().st_size / 1000),
            "object file (kB)": round((folder / "controller.o").stat().st_size / 1000),
        }
