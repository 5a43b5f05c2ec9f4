"""`glassgait evaluate transitions`: gaits that change while walking."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar

import tyro
from annotated_types import MinLen

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario, load_scenarios
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.settings import DISTINCT, FEW, Settings
from glassgait.models.task.gait import Gait, load_gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.studies.common.console import console
from glassgait.studies.common.experts import find_expert
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.rollouts.jobs import finish_jobs
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import Gaits, WorkersConfig, gaits_named
from glassgait.studies.common.tables import json_records, print_table, write_metrics, write_table
from glassgait.studies.distillation.students.library import find_walker
from glassgait.studies.evaluation.transitions.config import TransitionConfig
from glassgait.studies.evaluation.transitions.figures import transition_figure
from glassgait.studies.evaluation.transitions.jobs import TransitionJob, jobs_of_pairs
from glassgait.studies.evaluation.transitions.rolling import roll_transition
from glassgait.studies.evaluation.transitions.tables import (
    readable_table,
    summary_table,
    transition_table,
)


@dataclass(frozen=True)
class Transitions(Settings):
    """Change the gait of walking robots, each to each, and tell who falls and how soon.

    Attributes:
        gait: Names of gaits; `all` for every gait that ships.
        policies: Who walks in every gait: `expert`, or kinds of students. `--policy` is another
            name for it.
        scenario: The scenarios: names of those that ship, or `all` of them, and paths of scenario
            files. `--worlds` is another name for it.
        transitions: How robots are rolled out, and what eases the change.
        via: A gait on the way between any two others; none by default.
        workers: Where rollouts run.
        resume: Continue the run that the folder holds.
        output: Folder of the results.
    """

    title: ClassVar[str] = "transitions"

    gait: Gaits = ("walk", "trot", "pace", "bound")
    policies: Annotated[
        tuple[str, ...], MinLen(1), FEW, DISTINCT, tyro.conf.arg(aliases=("--policy",))
    ] = ("expert",)
    scenario: Annotated[
        tuple[str, ...], MinLen(1), FEW, DISTINCT, tyro.conf.arg(aliases=("--worlds",))
    ] = ("training",)
    transitions: Annotated[TransitionConfig, tyro.conf.arg(name="")] = field(
        default_factory=TransitionConfig
    )
    via: str | None = None
    workers: Annotated[WorkersConfig, tyro.conf.arg(name="")] = field(default_factory=WorkersConfig)
    resume: bool = False
    output: Path = Path("runs/transitions")

    def run(self) -> None:
        """Rolls every pair of gaits out, and writes tables and figure."""
        gaits = [load_gait(name) for name in gaits_named(self.gait)]
        scenarios = load_scenarios(self.scenario)
        jobs = self._jobs(gaits, scenarios)
        inputs = {"policies": " ".join(sorted({job.digest() for job in jobs}))}
        run = {
            "study": "evaluate transitions",
            "settings": self,
            "inputs": inputs,
            "resume": self.resume,
        }
        with open_run(self.output, **run), parallel_backend(self.workers.backend):
            folder, processes = self.output / "rollouts", self.workers.processes
            robots = finish_jobs(jobs, roll_transition, folder, processes=processes)
            titles = {name: scenario.title for name, scenario in scenarios.items()}
            table = transition_table(robots)
            write_table(robots, self.output / "robots")
            write_table(readable_table(table, titles), self.output / "transitions")
            write_metrics(json_records(table), self.output / "metrics.json")
            save_figure(transition_figure(table, titles), self.output / "transitions")
        print_table("who changes the gait without a fall", summary_table(table, titles))
        console.print(f"written to {self.output}")

    def _jobs(self, gaits: Sequence[Gait], scenarios: dict[str, Scenario]) -> list[TransitionJob]:
        """Lists the jobs, and refuses what cannot be rolled out."""
        if len(gaits) < 2:
            raise InputError("transitions: one gait changes to no other; name two or more")
        via = None if self.via is None else load_gait(self.via)
        there = [*gaits, *([] if via is None or via in gaits else [via])]
        common = GaitSwitch(there).gait
        for speed in self.transitions.speeds:
            FixedCommand(speed=speed, dwell=common.dwell[0]).check(common)
        for name, scenario in scenarios.items():
            if scenario.accuracy is not None:
                raise InputError(
                    f"transitions: scenario {name!r} is continuous; name scenarios of discrete time"
                )
        walkers = {policy: _walkers(policy, there) for policy in self.policies}
        return jobs_of_pairs(gaits, walkers, scenarios, self.transitions, via)


def _walkers(policy: str, gaits: Sequence[Gait]) -> dict[str, AlternatingController]:
    """Finds who walks in each gait: the expert, or the student of a kind."""
    return {gait.name: find_walker(policy, find_expert(gait)) for gait in gaits}
