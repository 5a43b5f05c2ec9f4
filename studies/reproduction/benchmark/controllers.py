"""Time of one step of controllers in C, and their size."""

import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from glassgait.models.export.controller import ControllerSource, write_controller
from glassgait.models.files import write_atomically
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.switched import SwitchedPolicy
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.pages import page_template
from glassgait.studies.common.policies import ALL, Policies
from glassgait.studies.export.command import controller_name
from glassgait.studies.export.files import FLAGS, compile_c, write_source

COUNT = 20_000
"""Steps that are timed."""

REPETITIONS = 5
"""Repetitions, of which the fastest is reported: the machine does other work too."""


@dataclass(frozen=True)
class Times:
    """How long a call takes.

    Attributes:
        median: By the clock on the wall (µs).
        late: 99.9th percentile by the thread's own clock (µs), which does not run while the machine
            does other work.
    """

    median: float
    late: float


def fastest(measure: Callable[[], Sequence[Times]]) -> tuple[Sequence[Times], float]:
    """Measures several times, and returns the repetition whose first median is the least.

    Returns:
        Its times, and the machine's load after it (average number of processes that would run, over
        a minute).
    """
    found = [(measure(), os.getloadavg()[0]) for _ in range(REPETITIONS)]
    return min(found, key=lambda one: one[0][0].median)


def call_times(call: Callable[[Any], Any], rows: np.ndarray | list[Any], count: int) -> Times:
    """Times calls on one of m rows after the other, the first again after the last."""
    wall, thread = np.empty(count), np.empty(count)
    for k in range(count):
        row = rows[k % len(rows)]
        own, begun = time.thread_time(), time.perf_counter()
        call(row)
        wall[k] = time.perf_counter() - begun
        thread[k] = time.thread_time() - own
    return Times(1e6 * float(np.median(wall)), 1e6 * float(np.quantile(thread, 0.999)))


def controller_times(found: Policies, count: int = COUNT) -> pd.DataFrame:
    """Times the controllers of a gait's policies, compiled with the system's compiler.

    Returns:
        A row a policy: median and 99.9th percentile (µs) of the policy alone, of the estimator and
        of a whole step; size of the C file and of what it compiles to (kB); the machine's load.

    Raises:
        InputError: if there is no compiler.
    """
    return pd.DataFrame(
        {"policy": kind, **_measured(found.gait, controller, kind, count)}
        for kind, controller in found.controllers([ALL]).items()
    )


def switching_times(several: Sequence[Policies], count: int = COUNT) -> pd.DataFrame:
    """Times controllers of several gaits, which change the gait every 100 steps.

    Returns:
        A row for each kind of policy that all these gaits have, as of `controller_times` without
        the parts of a step.

    Raises:
        InputError: if there is no compiler.
    """
    switch = GaitSwitch([found.gait for found in several])
    controllers = [found.controllers([ALL]) for found in several]
    shared = [kind for kind in controllers[0] if all(kind in own for own in controllers)]
    rows = []
    for kind in shared:
        switched = alone(SwitchedPolicy(switch, [own[kind] for own in controllers]))
        rows.append({"policy": kind, **_measured(switch, switched, kind, count)})
    return pd.DataFrame(rows)


def _measured(
    gait: Gait | GaitSwitch, controller: AlternatingController, kind: str, count: int
) -> dict[str, float]:
    several = isinstance(gait, GaitSwitch)
    names = "_".join(own.name for own in gait.gaits) if several else gait.name
    written = write_controller(
        gait,
        controller,
        name=controller_name(names, kind),
        policy_name=kind,
        version=version("glassgait"),
    )
    return _timed(gait.gait if several else gait, written, count)


def _timed(gait: Gait, written: ControllerSource, count: int) -> dict[str, float]:
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
            "has_imu": written.has_imu,
            "has_odometry": written.has_odometry,
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
