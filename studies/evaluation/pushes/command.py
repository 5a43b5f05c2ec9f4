"""`glassgait evaluate pushes`: which pushes each policy survives."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import tyro
from annotated_types import Ge, Gt, Le, MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.settings import DISTINCT, FEW, Count, Seed, Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.gait import Gait, load_gait
from glassgait.studies.common.console import console
from glassgait.studies.common.each_policy import measure_each
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.rollouts.seeds import REPORTED_SEEDS
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import Gaits, gaits_named, refuse_files_of_several, run_each
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import find_walkers, inputs_of_walkers
from glassgait.studies.evaluation.pushes.basin import PushGrid, failure_counts, push_everywhere
from glassgait.studies.evaluation.pushes.figures import push_figure
from glassgait.studies.evaluation.pushes.tables import Basin, push_table, summary_table

PushSpeed = Annotated[float, Gt(0.0), Le(20.0)]

Seconds = Annotated[float, Ge(1.0), Le(9.0)]
"""Time from the push to the end (s): a second at least, in which a robot must walk; with 10 s comes
a new command."""


@dataclass(frozen=True)
class PushBasin(Settings):
    """Push walking robots from every side, and draw which pushes each policy survives.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships.
        policies: Who walks: `expert`, kinds of students, or paths of policy files; by default the
            expert and every student that there is. `--policy` is another name for it.
        command: What the robots are told to do.
        n_directions: Directions of pushes, equally far apart.
        speeds: What a push adds to the trunk's velocity (m/s).
        n_phases: Instants of the gait's cycle in which robots are pushed.
        seconds: Time from the push until a robot must still walk (s).
        seed: Seed of initial states and noise.
        distillation: Folder of a distillation; by default runs/distillation/<gait>, and where that
            lacks a student, the shipped one.
        expert: Policy file of the expert; by default the shipped one, or what was trained here.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/pushes/<gait> by default. Of several gaits each has its
            folder <gait> in it.
    """

    title: ClassVar[str] = "pushes"

    gait: Gaits = ("trot",)
    policies: Annotated[tuple[str, ...], FEW, DISTINCT, tyro.conf.arg(aliases=("--policy",))] = ()
    command: FixedCommand = field(default_factory=FixedCommand)
    n_directions: Annotated[Count, Ge(3), Le(360)] = 12
    speeds: Annotated[tuple[PushSpeed, ...], MinLen(1), FEW, DISTINCT] = (
        0.3,
        0.6,
        0.9,
        1.2,
        1.5,
        1.8,
        2.1,
        2.4,
        2.7,
        3.0,
    )
    n_phases: Annotated[Count, Le(1000)] = 8
    seconds: Seconds = 5.0
    seed: Seed = REPORTED_SEEDS[0]
    distillation: Path | None = None
    expert: Path | None = None
    resume: bool = False
    output: Path | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if list(self.speeds) != sorted(self.speeds):
            raise InputError(f"{self.title}: speeds is {self.speeds}; name the least first")

    def run(self) -> None:
        """Runs the study of every gait."""
        names = gaits_named(self.gait)
        own = [Path(name) for name in self.policies if Path(name).suffix]
        refuse_files_of_several(names, self.expert, self.distillation, *own)
        if len(names) == 1:
            replace(self, gait=names)._run_one()
            return
        folder = self.output or Path("runs/pushes")

        def run_alone(name: str) -> None:
            replace(self, gait=(name,), output=folder / load_gait(name).name)._run_one()

        run_each(names, run_alone)

    def _run_one(self) -> None:
        """Runs the study of the only gait."""
        gait = load_gait(self.gait[0])
        expert = find_expert(gait, self.expert)
        self.command.check(gait)
        walkers = find_walkers(
            self.policies, expert, self.distillation, shipped=self.expert is None
        )
        inputs = {"gait": gait.digest(), **inputs_of_walkers(walkers)}
        folder = self.output or Path("runs/pushes") / gait.name
        run = {
            "study": "evaluate pushes",
            "settings": self,
            "inputs": inputs,
            "resume": self.resume,
        }
        with open_run(folder, **run) as identity:
            records = measure_each(
                walkers, lambda walker: self._push(gait, walker), folder, of=identity
            )
            basins = {
                name: Basin(self._grid(), np.array(kept["survived"]), kept["failures"])
                for name, kept in records.items()
            }
            table = summary_table(basins)
            write_table(table, folder / "summary")
            write_table(push_table(basins), folder / "pushes")
            write_metrics(json_records(table), folder / "metrics.json")
            save_figure(push_figure(basins, self._told(gait)), folder / "pushes")
        print_table(f"{gait.name}: pushes", table)
        console.print(f"written to {folder}")

    def _grid(self) -> PushGrid:
        directions = 2.0 * np.pi * np.arange(self.n_directions) / self.n_directions
        return PushGrid(directions, np.array(self.speeds), self.n_phases)

    def _push(self, gait: Gait, walker: AlternatingController) -> dict[str, Any]:
        pushed = push_everywhere(
            gait,
            walker,
            Scenario(command=self.command),
            self._grid(),
            n_steps=round(self.seconds / CONTROL_PERIOD),
            seed=self.seed,
        )
        survived = pushed.survived.sum(axis=2).tolist()
        return {"survived": survived, "failures": failure_counts(pushed)}

    def _told(self, gait: Gait) -> str:
        return (
            f"{gait.name.capitalize()} at {self.command.speed:g} m/s: which pushes are survived. "
            f"Direction as angle, speed (m/s) as radius; the line is where half survive"
        )
