"""`glassgait evaluate stability`: how each policy's gait answers small differences."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro
from annotated_types import Gt, Le, MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.settings import DISTINCT, FEW, Count, Seed, Settings
from glassgait.models.task.command import Command
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.each_policy import measure_each
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.rollouts.config import distilled_speeds
from glassgait.studies.common.rollouts.seeds import REPORTED_SEEDS
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import Gaits, gaits_named, refuse_files_of_several, run_each
from glassgait.studies.common.tables import print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import find_walkers, inputs_of_walkers
from glassgait.studies.evaluation.stability.analysis import analyse
from glassgait.studies.evaluation.stability.figures import stability_figure
from glassgait.studies.evaluation.stability.strides import StrideMap
from glassgait.studies.evaluation.stability.tables import (
    prediction_table,
    stability_table,
    summary_table,
)

SLOWEST = 0.25
"""Least speed by default (m/s)."""

StepSize = Annotated[float, Gt(0.0), Le(1.0)]


@dataclass(frozen=True)
class Stability(Settings):
    """Tell whether small differences grow or fade from one stride to the next, and test it.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships.
        policies: Who walks: `expert`, kinds of students, or paths of policy files; by default the
            expert and every student that there is. `--policy` is another name for it.
        speeds: Commanded forward speeds (m/s); by default three from 0.25 to the greatest of
            distillation.
        yaw_rates: Commanded yaw rates (rad/s).
        dwell: Commanded dwell of every speed and yaw rate (control steps).
        dwells: Further dwells at the middle speed and yaw rate; every one of the gait by default.
        n_strides: Strides that a gait has to settle, from standing.
        step_sizes: Sizes of the differences that the map is differentiated by, in units of what a
            gait sways (0.01 m, 0.05 rad, 0.1 m/s, …); their spread tells the error.
        seed: Seed of the differences that averaged radii are measured by.
        distillation: Folder of a distillation; by default runs/distillation/<gait>, and where that
            lacks a student, the shipped one.
        expert: Policy file of the expert; by default the shipped one, or what was trained here.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/stability/<gait> by default. Of several gaits each has
            its folder <gait> in it.
    """

    title: ClassVar[str] = "stability"

    gait: Gaits = ("trot",)
    policies: Annotated[tuple[str, ...], FEW, DISTINCT, tyro.conf.arg(aliases=("--policy",))] = ()
    speeds: Annotated[tuple[float, ...], FEW, DISTINCT] = ()
    yaw_rates: Annotated[tuple[float, ...], MinLen(1), FEW, DISTINCT] = (-0.5, 0.0, 0.5)
    dwell: Count = 8
    dwells: Annotated[tuple[int, ...], FEW, DISTINCT] = ()
    n_strides: Count = 60
    step_sizes: Annotated[tuple[StepSize, ...], MinLen(2), FEW, DISTINCT] = (1e-3, 3e-3, 1e-2)
    seed: Seed = REPORTED_SEEDS[0]
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def run(self) -> None:
        """Runs the study of every gait."""
        names = gaits_named(self.gait)
        own = [Path(name) for name in self.policies if Path(name).suffix]
        refuse_files_of_several(names, self.expert, self.distillation, *own)
        if len(names) == 1:
            replace(self, gait=names)._run_one()
            return
        folder = self.output or Path("runs/stability")

        def run_alone(name: str) -> None:
            replace(self, gait=(name,), output=folder / load_gait(name).name)._run_one()

        run_each(names, run_alone)

    def _run_one(self) -> None:
        """Runs the study of the only gait."""
        gait = load_gait(self.gait[0])
        expert = find_expert(gait, self.expert)
        commands = self._commands(gait)
        walkers = find_walkers(
            self.policies, expert, self.distillation, shipped=self.expert is None
        )
        inputs = {"gait": gait.digest(), **inputs_of_walkers(walkers)}
        folder = self.output or Path("runs/stability") / gait.name
        run = {
            "study": "evaluate stability",
            "settings": self,
            "inputs": inputs,
            "resume": self.resume,
        }
        with open_run(folder, **run) as identity:
            results = measure_each(
                walkers, lambda walker: self._analyse(gait, walker, commands), folder, of=identity
            )
            _write(results, gait, folder)
        print_table(f"{gait.name}: the stride map", summary_table(results))
        console.print(f"written to {folder}")

    def _commands(self, gait: Gait) -> Command:
        """Lists the commands: every speed with every yaw rate, then the further dwells.

        Raises:
            InputError: if the gait is not made for one.
        """
        speeds = self.speeds or tuple(np.linspace(SLOWEST, distilled_speeds(gait)[1], 3).tolist())
        dwells = self.dwells or tuple(range(gait.dwell[0], gait.dwell[1] + 1))
        grid = [(speed, rate, self.dwell) for speed in speeds for rate in self.yaw_rates]
        middle = speeds[len(speeds) // 2], self.yaw_rates[len(self.yaw_rates) // 2]
        grid += [(*middle, dwell) for dwell in dwells if dwell != self.dwell]
        for speed, yaw_rate, dwell in grid:
            FixedCommand(speed, yaw_rate, dwell).check(gait)
        values = np.array(grid, dtype=float)
        return Command(values[:, :2], values[:, 2])

    def _analyse(self, gait: Gait, walker: AlternatingController, commands: Command) -> list[Any]:
        return analyse(
            StrideMap(gait, walker, commands),
            n_strides=self.n_strides,
            step_sizes=self.step_sizes,
            seed=self.seed,
        )


def _write(results: Mapping[str, list[Any]], gait: Gait, folder: Path) -> None:
    write_table(summary_table(results), folder / "summary")
    write_table(stability_table(results), folder / "stability")
    write_table(prediction_table(results), folder / "prediction")
    write_metrics(_without_nan(results), folder / "metrics.json")
    save_figure(stability_figure(results, gait.name.capitalize()), folder / "stability")


def _without_nan(values: Any) -> Any:
    """Puts null where JSON has no NaN."""
    if isinstance(values, Mapping):
        return {name: _without_nan(value) for name, value in values.items()}
    if isinstance(values, list):
        return [_without_nan(value) for value in values]
    return None if isinstance(values, float) and not np.isfinite(values) else values
