"""Experiments: policies are measured in scenarios, case by case, and reported.

A subclass of `Experiment` gives `title`, `measure` and `report`. Heavy libraries are imported in
the functions that need them, so that `--help` does not wait for Drake and PyTorch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import tyro
from annotated_types import MinLen
from joblib import delayed

from glassgait.models.errors import InputError
from glassgait.models.files import read_record, write_record
from glassgait.models.settings import DISTINCT, FEW, Count, Seed, Settings, checked
from glassgait.models.task.termination import PHYSICAL_FALL, Falls
from glassgait.studies.common.console import console, note, progress_bar, report_errors, say
from glassgait.studies.common.jobs import (
    Gaits,
    Seeds,
    Workers,
    gaits_named,
    run_parallel,
)
from glassgait.studies.common.run import default_folder, open_run

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from glassgait.diagrams.scenario import Scenario
    from glassgait.models.policies.controller import Controller
    from glassgait.models.policies.policy import Policy
    from glassgait.models.task.gait import Gait
    from glassgait.studies.common.policies import Policies

REPORTED_SEEDS = range(7000, 7005)
"""Seeds of the rollouts that tables report, unless others are named."""

SELECTION_SEEDS = range(500, 510)
"""Seeds that choose among candidates."""

FORMER_SEEDS = range(1000, 1005)
"""Seeds that chose which of the shipped networks and recipes were kept."""

PolicyNames = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of policies, as `Policies.controllers` takes them."""

ScenarioNames = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of scenarios that ship, or `all` of them, and paths of scenario files."""


def refuse_to_report(seeds: Sequence[int]) -> None:
    """Raises an InputError if a policy may be lucky in one of the seeds, which chose it."""
    for chose, what in ((SELECTION_SEEDS, "candidates"), (FORMER_SEEDS, "what ships")):
        for seed in {*seeds} & {*chose}:
            kept = f"{chose[0]} to {chose[-1]} chose among {what}"
            raise InputError(f"--seed: leads to {seed}, but {kept}; name others")


@checked
class PolicySource(Settings):
    """Settings of a command that takes policies.

    Attributes:
        robot: Name of a robot, or path of its robot.yaml; by default that of the policies.
        source: Folder of a run of train, distill or refine to take policies from; by default those
            that ship and, of a gait that does not ship, those of runs/distill/<gait> and
            runs/train/<gait>.
    """

    robot: str | None = None
    source: Path | None = None


@checked
class OneGait(PolicySource):
    """Settings of a command that takes policies of one gait.

    Attributes:
        gait: Name of a gait, or path of a gait file.
    """

    gait: str = "trot"

    def policies(self) -> Policies:
        """Finds the policies, and prints their origin."""
        from glassgait.models.policies.library import find_gait
        from glassgait.studies.common.policies import find_policies

        return find_policies(find_gait(self.gait, self.robot), self.source, self.robot)


@dataclass(frozen=True)
class Case:
    """One measurement: a controller in a scenario, with a seed.

    The labels are columns that distinguish the case's rows from the others'.
    """

    labels: dict[str, Any]
    gait: Gait
    controller: Controller
    scenario: Scenario
    seed: int

    @property
    def name(self) -> str:
        """The name in progress lines and of the file that keeps the case's table."""
        values = (f"{x:.3g}" if isinstance(x, float) else str(x) for x in self.labels.values())
        return "_".join(values).replace("/", "-")


def run_cases(
    cases: Sequence[Case],
    measure: Callable[[Case], pd.DataFrame],
    folder: Path,
) -> pd.DataFrame:
    """Measures cases in parallel, except those whose tables the folder holds already.

    Returns their rows with labels, in the order of the cases.
    """
    import pandas as pd

    paths = {folder / f"{case.name}.json": case for case in cases}
    pending = {path: case for path, case in paths.items() if not path.exists()}
    work = (delayed(_measure)(measure, case, path) for path, case in pending.items())
    with progress_bar(len(cases), len(cases) - len(pending)) as (progress, bar):
        for name in run_parallel(work, in_order=False):
            progress.update(bar, advance=1, text=name)
    # Read all tables back, so that resumed runs and whole ones give the same bytes.
    return pd.concat([pd.DataFrame(read_record(path)) for path in paths], ignore_index=True)


def _measure(measure: Callable[[Case], pd.DataFrame], case: Case, path: Path) -> str:
    table = measure(case)
    labels = {name: [value] * len(table) for name, value in case.labels.items()}
    write_record(path, labels | table.to_dict(orient="list"))
    return case.name


@dataclass(frozen=True)
class Report:
    """The results of an experiment: what is written, by file name, and what is printed."""

    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    metrics: Any = None
    figures: Mapping[str, Figure] = field(default_factory=dict)
    shown: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    line: str = ""

    def write(self, folder: Path) -> None:
        """Writes tables as CSV and Markdown, figures as PNG and PDF, and metrics."""
        from glassgait.studies.common.figures import save_figure
        from glassgait.studies.common.tables import write_metrics, write_table

        for name, table in self.tables.items():
            write_table(table, folder / name)
        write_metrics(self.metrics, folder / "metrics.json")
        for name, figure in self.figures.items():
            save_figure(figure, folder / name)

    def show(self) -> None:
        """Prints the tables that are shown, and the sentence."""
        from glassgait.studies.common.tables import print_table

        for title, table in self.shown.items():
            print_table(title, table)
        if self.line:
            say(self.line)


@checked
class Experiment(PolicySource):
    """Measures policies in scenarios.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships.
        policy: Policies: `expert`, kinds of students, `all` for the expert and every student, and
            paths of policy files.
        scenario: Scenarios: names of those that ship, groups `all`, `grounds` and `harsh`, and
            paths of scenario files.
        falls: What ends an episode: any of the `task`'s failures, or only a `physical` fall, the
            trunk or a thigh on the ground or a lean over 60°.
        n_robots: Number of robots for each seed.
        seed: First seed of all that is drawn.
        n_seeds: Number of seeds: seed, seed + 1, …
        workers: Where cases run.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/<title>/<gait> by default, followed by the policies
            that are named. Of several gaits each has its folder <gait> in it.
    """

    title: ClassVar[str] = "experiment"

    gait: Gaits = ("trot",)
    policy: PolicyNames = ("all",)
    scenario: ScenarioNames = ("nominal",)
    falls: Falls = "task"
    n_robots: Count = 26
    seed: Seed = REPORTED_SEEDS[0]
    n_seeds: Seeds = 1
    workers: Annotated[Workers, tyro.conf.arg(name="")] = field(default_factory=Workers)
    resume: bool = False
    output: Path | None = None

    def measure(self, case: Case) -> pd.DataFrame:
        """Measures one case, in another process; the case's labels are put before the rows."""
        raise NotImplementedError

    def report(self, table: pd.DataFrame) -> Report:
        """Turns the rows of all cases, with labels, into tables, figures and metrics."""
        raise NotImplementedError

    def prepared(self, cases: list[Case]) -> list[Case]:
        """Returns the cases with what they share with the report, made before all of them."""
        return cases

    def cases(self) -> list[Case]:
        """Lists every policy in every scenario with every seed, the slow scenarios first.

        In a scenario all policies meet the same initial states, commands and noise: robots can be
        compared in pairs.
        """
        seeds = range(self.seed, self.seed + self.n_seeds)
        refuse_to_report(seeds)
        for scenario, gait in product(self.scenarios.values(), self.gaits):
            scenario.command.check(gait)
        by_cost = sorted(self.scenarios.items(), key=lambda named: named[1].max_robots or math.inf)
        return [
            Case(
                {"gait": gait.name, "policy": policy, "scenario": name, "seed": seed},
                *(gait, controller, scenario, seed),
            )
            for (name, scenario), gait in product(by_cost, self.gaits)
            for policy, controller in self.controllers[gait.name].items()
            for seed in seeds
        ]

    def run(self) -> None:
        """Runs the experiment of each gait, and writes and prints its report."""
        names = gaits_named(self.gait)
        for one in (replace(self, gait=(name,)) for name in names):
            within = self.output and (self.output / one.gaits[0].name if names[1:] else self.output)
            one.run_in(within or one.default_output())

    def run_in(self, folder: Path) -> None:
        """Runs the experiment of all gaits together, in a folder."""
        cases = self.cases()
        for policies in self.policies.values():
            note(policies.origin)

        # Record digests of what the run reads; a resumed run must read the same.
        acting = (policy for case in cases for policy in case.controller.policies.values())
        read = {"gait": self.gaits, "scenario": self.scenarios.values(), "policy": acting}
        digests = {name: [part.digest() for part in parts] for name, parts in read.items()}
        inputs = {name: " ".join(dict.fromkeys(several)) for name, several in digests.items()}
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run), self.workers.pool():
            # Processes are sent a copy without the policies that this one has found.
            report = self.report(
                run_cases(self.prepared(cases), replace(self).measure, folder / "cases")
            )
            report.write(folder)
        report.show()
        console.print(f"written to {folder}")

    def default_output(self) -> Path:
        """Returns the folder of a run where none is named."""
        others = () if self.policy == type(self).policy else self.policy
        called = "_".join(Path(name).stem for name in (*self.gait, *others))
        first = self.policies[self.gaits[0].name]
        return default_folder(self.title, first.robot.name) / called

    @cached_property
    def gaits(self) -> list[Gait]:
        """The gaits."""
        from glassgait.models.policies.library import find_gait

        return [find_gait(name, self.robot) for name in gaits_named(self.gait)]

    @cached_property
    def scenarios(self) -> dict[str, Scenario]:
        """The scenarios by name."""
        from glassgait.diagrams.scenario import load_scenarios

        found = load_scenarios(self.scenario)
        if self.falls == "task":
            return found
        return {name: replace(own, limits=PHYSICAL_FALL) for name, own in found.items()}

    @cached_property
    def policies(self) -> dict[str, Policies]:
        """Where each gait's policies are from, by the gait's name."""
        from glassgait.studies.common.policies import find_policies

        where = self.source, self.robot
        return {gait.name: find_policies(gait, *where, quiet=True) for gait in self.gaits}

    @cached_property
    def controllers(self) -> dict[str, dict[str, Controller]]:
        """Each policy without the expert, by the gait's name and the policy's."""
        found = {}
        for gait, policies in self.policies.items():
            names = policies.named(self.policy)
            # Of several gaits, and of the default policies, missing ones are left out.
            if len(self.gaits) > 1 or self.policy == type(self).policy:
                names = [name for name in names if name in ("expert", *policies.files)]
            found[gait] = policies.controllers(names)
        if not any(found.values()):
            raise InputError(f"--policy {' '.join(self.policy)}: no gait has such a policy")
        return found

    def acting(self, gait: str) -> dict[str, Policy]:
        """Returns the policies of a gait."""
        return {name: controller.policy for name, controller in self.controllers[gait].items()}

    def refuse_several_scenarios(self) -> None:
        """Raises an InputError if there are several scenarios, for studies of one."""
        if len(self.scenarios) > 1:
            raise InputError(f"--scenario: {self.title} is of one scenario; name one")


def run_from_command_line(kind: type[Experiment]) -> None:
    """Runs an experiment by the settings of the command line."""
    with report_errors():
        tyro.cli(kind, config=(tyro.conf.FlagCreatePairsOff,)).run()
