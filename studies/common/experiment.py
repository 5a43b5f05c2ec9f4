"""Experiments: measure policies in scenarios, case by case, and report the results.

A subclass of `Experiment` defines `title`, `measure` and `report`. Functions import heavy
libraries themselves, so that `--help` does not wait for Drake and PyTorch.
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
from glassgait.studies.common.jobs import Gaits, Seeds, Workers, expand_gaits, run_parallel
from glassgait.studies.common.run import default_folder, open_run

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from glassgait.diagrams.scenario import Scenario
    from glassgait.models.policies.controller import Controller
    from glassgait.models.policies.policy import Policy
    from glassgait.models.task.gait import Gait
    from glassgait.studies.common.policies import Policies

REPORTED_SEEDS = range(7000, 7005)  # default seeds of the rollouts in reports
SELECTION_SEEDS = range(500, 510)  # seeds for the selection among candidates
FORMER_SEEDS = range(1000, 1005)  # seeds with which the shipped networks and recipes were selected

PolicyNames = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of policies for `Policies.controllers`."""

ScenarioNames = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of shipped scenarios or of their groups, and paths of scenario files."""


def check_reported_seeds(seeds: Sequence[int]) -> None:
    """Raises an InputError for seeds with which policies were selected, as scores are biased."""
    for used, choice in ((SELECTION_SEEDS, "candidates"), (FORMER_SEEDS, "shipped policies")):
        for seed in {*seeds} & {*used}:
            reason = f"seeds {used[0]} to {used[-1]} selected among {choice}"
            raise InputError(f"--seed: the seeds include {seed}, but {reason}; give other seeds")


@checked
class PolicySource(Settings):
    """Settings of a command that loads policies.

    Attributes:
        robot: Name of a robot, or path of its robot.yaml; by default the policies' robot.
        source: Folder of a run of train, distill or refine with the policies. By default policies
            of built-in gaits are the shipped ones, and those of other gaits come from
            runs/distill/<gait>, otherwise from runs/train/<gait>.
    """

    robot: str | None = None
    source: Path | None = None


@checked
class OneGait(PolicySource):
    """Settings of a command that loads policies of one gait.

    Attributes:
        gait: Name of a gait, or path of a gait file.
    """

    gait: str = "trot"

    def policies(self) -> Policies:
        """Finds the policies and prints their origin."""
        from glassgait.models.policies.library import find_gait
        from glassgait.studies.common.policies import find_policies

        return find_policies(find_gait(self.gait, self.robot), self.source, self.robot)


@dataclass(frozen=True)
class Case:
    """One measurement: a controller in a scenario, with a seed.

    The labels are the columns that identify the case's rows.
    """

    labels: dict[str, Any]
    gait: Gait
    controller: Controller
    scenario: Scenario
    seed: int

    @property
    def name(self) -> str:
        """The case's name in progress lines, and the stem of its table's file."""
        values = (f"{x:.3g}" if isinstance(x, float) else str(x) for x in self.labels.values())
        return "_".join(values).replace("/", "-")


def run_cases(
    cases: Sequence[Case], measure: Callable[[Case], pd.DataFrame], folder: Path
) -> pd.DataFrame:
    """Measures in parallel the cases whose tables are not in the folder yet.

    Returns the rows of all cases with labels, in the order of the cases.
    """
    import pandas as pd

    paths = {folder / f"{case.name}.json": case for case in cases}
    pending = {path: case for path, case in paths.items() if not path.exists()}
    work = (delayed(_measure)(measure, case, path) for path, case in pending.items())
    with progress_bar(len(cases), len(cases) - len(pending)) as (progress, bar):
        for name in run_parallel(work, in_order=False):
            progress.update(bar, advance=1, text=name)
    # Read all tables from files, so that a resumed run gives the same bytes.
    return pd.concat([pd.DataFrame(read_record(path)) for path in paths], ignore_index=True)


def _measure(measure: Callable[[Case], pd.DataFrame], case: Case, path: Path) -> str:
    table = measure(case)
    labels = {name: [value] * len(table) for name, value in case.labels.items()}
    write_record(path, labels | table.to_dict(orient="list"))
    return case.name


@dataclass(frozen=True)
class Report:
    """The results of an experiment: files by name, and tables and a sentence to print."""

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
        """Prints the tables in `shown` and the sentence."""
        from glassgait.studies.common.tables import print_table

        for title, table in self.shown.items():
            print_table(title, table)
        if self.line:
            say(self.line)


@checked
class Experiment(PolicySource):
    """Measures policies in scenarios.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every built-in gait.
        policy: `expert`, kinds of students, `all` for the expert and every student, or paths of
            policy files.
        scenario: Names of shipped scenarios, groups `all`, `grounds` and `harsh`, or paths of
            scenario files.
        falls: What ends an episode: any failure of the `task`, or only a `physical` fall (trunk or
            thigh on the ground, or a lean over 60°).
        n_robots: Number of robots per seed.
        seed: First random seed.
        n_seeds: Number of seeds: seed, seed + 1, …
        workers: Workers that run the cases.
        resume: Continue the run in the folder.
        output: Folder of the results. By default runs/<command>/<gait>, with the names of given
            policies appended. With several gaits, each has a folder <gait> in it.
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
        """Measures one case, in another process; returns rows without the case's labels."""
        raise NotImplementedError

    def report(self, table: pd.DataFrame) -> Report:
        """Makes tables, figures and metrics from the rows of all cases with their labels."""
        raise NotImplementedError

    def prepared(self, cases: list[Case]) -> list[Case]:
        """Adds data that cases and report share, before the first case is measured."""
        return cases

    def cases(self) -> list[Case]:
        """Lists every policy in every scenario with every seed, slow scenarios first.

        In a scenario all policies have the same initial states, commands and noise, so that robots
        can be compared in pairs.
        """
        seeds = range(self.seed, self.seed + self.n_seeds)
        check_reported_seeds(seeds)
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
        """Runs the experiment for each gait, and writes and prints the reports."""
        names = expand_gaits(self.gait)
        for study in (replace(self, gait=(name,)) for name in names):
            output = self.output and self.output / (study.gaits[0].name if names[1:] else "")
            study.run_in(output or study.default_output())

    def run_in(self, folder: Path) -> None:
        """Runs the experiment for all gaits together, in one folder."""
        cases = self.cases()
        for policies in self.policies.values():
            note(policies.origin)

        # Record digests of the inputs, which must be the same when the run is resumed.
        acting = (policy for case in cases for policy in case.controller.policies.values())
        items = {"gait": self.gaits, "scenario": self.scenarios.values(), "policy": acting}
        digests = {name: [item.digest() for item in values] for name, values in items.items()}
        inputs = {name: " ".join(dict.fromkeys(values)) for name, values in digests.items()}
        run = {"study": self.title, "settings": self, "inputs": inputs, "resume": self.resume}
        with open_run(folder, **run), self.workers.pool():
            # Send worker processes a copy without the loaded policies.
            report = self.report(
                run_cases(self.prepared(cases), replace(self).measure, folder / "cases")
            )
            report.write(folder)
        report.show()
        console.print(f"written to {folder}")

    def default_output(self) -> Path:
        """Returns the default folder of the results."""
        policies = () if self.policy == type(self).policy else self.policy
        name = "_".join(Path(item).stem for item in (*self.gait, *policies))
        first = self.policies[self.gaits[0].name]
        return default_folder(self.title, first.robot.name) / name

    @cached_property
    def gaits(self) -> list[Gait]:
        from glassgait.models.policies.library import find_gait

        return [find_gait(name, self.robot) for name in expand_gaits(self.gait)]

    @cached_property
    def scenarios(self) -> dict[str, Scenario]:
        from glassgait.diagrams.scenario import load_scenarios

        scenarios = load_scenarios(self.scenario)
        if self.falls == "task":
            return scenarios
        return {name: replace(item, limits=PHYSICAL_FALL) for name, item in scenarios.items()}

    @cached_property
    def policies(self) -> dict[str, Policies]:
        """The available policies of each gait, by the gait's name."""
        from glassgait.studies.common.policies import find_policies

        source = self.source, self.robot
        return {gait.name: find_policies(gait, *source, quiet=True) for gait in self.gaits}

    @cached_property
    def controllers(self) -> dict[str, dict[str, Controller]]:
        """A controller of each policy that acts without the expert, by gait and policy name."""
        controllers = {}
        for gait, policies in self.policies.items():
            names = policies.expanded(self.policy)
            # Omit missing policies if there are several gaits or policies are the default.
            if len(self.gaits) > 1 or self.policy == type(self).policy:
                names = [name for name in names if name in ("expert", *policies.files)]
            controllers[gait] = policies.controllers(names)
        if not any(controllers.values()):
            raise InputError(f"--policy {' '.join(self.policy)}: no gait has it; give another one")
        return controllers

    def acting(self, gait: str) -> dict[str, Policy]:
        """Returns the policies of a gait."""
        return {name: controller.policy for name, controller in self.controllers[gait].items()}

    def require_one_scenario(self) -> None:
        """Raises an InputError if there are several scenarios."""
        if len(self.scenarios) > 1:
            raise InputError(f"--scenario: {self.title} takes one scenario; give one")


def run_from_command_line(cls: type[Experiment]) -> None:
    """Runs an experiment with the settings of the command line."""
    with report_errors():
        tyro.cli(cls, config=(tyro.conf.FlagCreatePairsOff,)).run()
