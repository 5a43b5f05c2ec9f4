"""Experiments: what to measure and what to report; all else is done here, once for all of them.

An experiment is a frozen dataclass with two methods:

    @dataclass(frozen=True)
    class Mine(Experiment):
        title: ClassVar[str] = "mine"

        def measure(self, case: Case) -> pd.DataFrame: ...

        def report(self, table: pd.DataFrame) -> Report: ...

`Mine().run()` and, from a file of one's own, `run_from_command_line(Mine)` find the policies, open
the run's folder, measure every policy in every scenario with every seed side by side, keep each
case as soon as it is done, continue a run that was stopped, and write and print the report.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar

import pandas as pd
import tyro
from annotated_types import MinLen
from matplotlib.figure import Figure

from glassgait.diagrams.scenario import TRAINING, Scenario, load_scenarios
from glassgait.models.errors import InputError
from glassgait.models.files import record_or_made, write_atomically
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.library import find_gait
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.settings import DISTINCT, FEW, Count, Range, Seed, checked
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.symmetry import mirrored_states
from glassgait.models.task.termination import Falls, limits_of
from glassgait.studies.common.cases import Case, refuse_commands, run_cases, slow_first
from glassgait.studies.common.console import console, say
from glassgait.studies.common.exit_codes import report_errors, take_signals
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.parallel.loop import parallel_backend
from glassgait.studies.common.policies import (
    ALL,
    EXPERT,
    Policies,
    PolicySource,
    find_policies,
    is_file,
)
from glassgait.studies.common.rollouts import REPORTED_SEEDS, RolloutConfig, refuse_to_report
from glassgait.studies.common.run_folder import open_run
from glassgait.studies.common.sweep import (
    ALL_GAITS,
    Gaits,
    Seeds,
    WorkersConfig,
    gaits_named,
    run_each,
)
from glassgait.studies.common.tables import print_table, write_metrics, write_table

PolicyNames = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of policies, as `Policies.controllers` takes them."""

ScenarioNames = Annotated[tuple[str, ...], MinLen(1), FEW, DISTINCT]
"""Names of scenarios that ship, or `all` of them, and paths of scenario files."""

Workers = Annotated[WorkersConfig, tyro.conf.arg(name="")]


@dataclass(frozen=True)
class Report:
    """What an experiment found.

    Attributes:
        tables: Tables by name, written as CSV and Markdown.
        metrics: What `metrics.json` holds.
        figures: Figures by name, written as PNG and PDF.
        shown: Tables that are printed, by title.
        lines: Sentences that are printed after them.
        files: Further files by name: their text, or a function that writes one.
    """

    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    metrics: Any = None
    figures: Mapping[str, Figure] = field(default_factory=dict)
    shown: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    lines: Sequence[str] = ()
    files: Mapping[str, str | Callable[[Path], None]] = field(default_factory=dict)

    def joined(self, other: "Report") -> "Report":
        """Puts another report behind this one; metrics of both are mappings, or None."""
        return Report(
            {**self.tables, **other.tables},
            {**(self.metrics or {}), **(other.metrics or {})} or None,
            {**self.figures, **other.figures},
            {**self.shown, **other.shown},
            [*self.lines, *other.lines],
            {**self.files, **other.files},
        )

    def write(self, folder: Path) -> None:
        """Writes tables, metrics, figures and files."""
        for name, table in self.tables.items():
            write_table(table, folder / name)
        if self.metrics is not None:
            write_metrics(self.metrics, folder / "metrics.json")
        for name, figure in self.figures.items():
            save_figure(figure, folder / name)
        for name, content in self.files.items():
            if isinstance(content, str):
                write_atomically(folder / name, content)
            else:
                content(folder / name)

    def show(self) -> None:
        """Prints the tables that are shown, and the sentences."""
        for title, table in self.shown.items():
            print_table(title, table)
        for line in self.lines:
            say(line)


@checked
class Experiment(PolicySource):
    """Measures policies in scenarios.

    Attributes:
        gait: Names of gaits, or paths of gait files; `all` for every gait that ships.
        policy: Policies: `expert`, kinds of students, `all` for the expert and every student, and
            paths of policy files.
        scenario: Scenarios: names of those that ship, `all` for every one of them, and paths of
            scenario files.
        falls: What ends an episode: any of the `task`'s failures, or a `physical` fall alone, the
            trunk or a thigh on the ground or a lean over 60°.
        n_robots: Number of robots for each seed.
        seed: First seed of all that is drawn.
        n_seeds: Number of seeds: seed, seed + 1, …
        workers: Where cases run.
        resume: Continue the run that the folder holds.
        output: Folder of the results; runs/<title>/<gait> by default, followed by the policies
            that are named.
    """

    title: ClassVar[str] = "experiment"

    together: ClassVar[bool] = False
    """Whether one run is of all gaits, rather than of one, in a folder <gait> of its own."""

    discrete: ClassVar[bool] = False
    """Whether scenarios of continuous time are refused."""

    mirrored: ClassVar[bool] = False
    """Whether gaits whose machines favour a side are left out."""

    of_students: ClassVar[bool] = False
    """Whether experts are refused."""

    by_expert: ClassVar[bool] = False
    """Whether policies are measured beside their expert, which then must be there."""

    one: ClassVar[tuple[str, ...]] = ()
    """Settings, `policy` or `scenario`, of which one alone is taken."""

    pooled: ClassVar[bool] = False
    """Whether a case is of all seeds at once, which `measure` finds in `seeds`."""

    axes: ClassVar[Mapping[str, str]] = {}
    """Further labels of cases, each with the setting or property whose values it takes.

    Of a mapping the keys are the labels, and `Case.values` holds what they stand for.
    """

    prepared: ClassVar[tuple[str, ...]] = ()
    """Properties that are worked out before all cases; those that are cached go where cases are."""

    inputs: ClassVar[Mapping[str, str]] = {}
    """What else the run's record holds a digest of, each with the property that returns it."""

    gait: Gaits = ("trot",)
    policy: PolicyNames = (ALL,)
    scenario: ScenarioNames = (TRAINING,)
    falls: Falls = "task"
    n_robots: Count = 26
    seed: Seed = REPORTED_SEEDS[0]
    n_seeds: Seeds = 1
    workers: Workers = field(default_factory=WorkersConfig)
    resume: bool = False
    output: Path | None = None

    def measure(self, case: Case) -> pd.DataFrame:
        """Measures one case; called in a process of its own.

        Args:
            case: A controller in a scenario, with a seed.

        Returns:
            Rows of the table, before which the case's labels are put; none where there is nothing
            to measure.
        """
        raise NotImplementedError

    def report(self, table: pd.DataFrame) -> Report:
        """Turns the rows of all cases into tables, figures and metrics.

        Args:
            table: What `measure` returned, with columns `gait`, `policy`, `scenario` and `seed`.
        """
        raise NotImplementedError

    def once(self, name: str, make: Callable[[], Any]) -> Any:
        """Returns what the run's folder keeps, so that a run that is continued does not repeat it.

        Args:
            name: What the folder calls it.
            make: Makes it, of what JSON can hold.
        """
        return record_or_made(self.folder / f"{name}.json", make, of=vars(self)["_place"][1])

    @property
    def folder(self) -> Path:
        """The folder of the run, while it runs."""
        return vars(self)["_place"][0]

    def cases(self) -> list[Case]:
        """Lists every policy in every scenario with every value of the axes and every seed."""
        axes = [_labelled(getattr(self, setting)) for setting in self.axes.values()]
        return [
            Case(
                {
                    "gait": gait.name,
                    "policy": policy,
                    "scenario": name,
                    **{axis: label for axis, (label, _) in zip(self.axes, point, strict=True)},
                    **({} if self.pooled else {"seed": seed}),
                },
                gait,
                controller,
                scenario,
                seed,
                values={axis: value for axis, (_, value) in zip(self.axes, point, strict=True)},
            )
            for name, scenario in slow_first(self.scenarios)
            for gait in self.gaits
            for policy, controller in self.controllers[gait.name].items()
            for point in product(*axes)
            for seed in self.seeds[: 1 if self.pooled else None]
        ]

    def run(self) -> None:
        """Runs the experiment, and writes and prints what it found."""
        named = gaits_named(self.gait)
        names = self._gaits_to_measure(named)
        if self.together or len(named) == 1:
            # The very same experiment holds the policies that it has found.
            own = self if names == self.gait else replace(self, gait=names)
            own._run_one(self.output or own.default_output(names))
            return

        def run_alone(name: str) -> None:
            own = replace(self, gait=(name,))
            own._run_one(
                self.output / own.gaits[0].name if self.output else own.default_output((name,))
            )

        run_each(names, run_alone)

    def _run_one(self, folder: Path) -> None:
        refuse_to_report(self.seeds)
        self._refuse()
        with (
            open_run(
                folder, study=self.title, settings=self, inputs=self._inputs(), resume=self.resume
            ) as identity,
            parallel_backend(self.workers.backend),
        ):
            vars(self)["_place"] = folder.absolute(), identity
            for name in self.prepared:
                getattr(self, name)
            table = run_cases(
                self.cases(),
                self.measure,
                folder / "cases",
                of=identity,
                processes=self.workers.processes,
            )
            report = self.report(table)
            report.write(folder)
        report.show()
        console.print(f"written to {folder}")

    def default_output(self, names: Sequence[str]) -> Path:
        """Returns the folder of a run of gaits where none is named.

        Policies stand in its name, where others are named than by default.
        """
        others = () if self.policy == type(self).policy else self.policy
        called = "_".join(Path(name).stem for name in (*names, *others))
        if names == self.gait:
            found = self.policies[self.gaits[0].name]
        else:
            found = self.policies_of(names[0], quiet=True)
        return found.output(self.title).parent / called

    @property
    def seeds(self) -> range:
        """Every seed."""
        return range(self.seed, self.seed + self.n_seeds)

    @cached_property
    def gaits(self) -> list[Gait]:
        """The gaits."""
        return [find_gait(name, self.robot) for name in gaits_named(self.gait)]

    @cached_property
    def scenarios(self) -> dict[str, Scenario]:
        """The scenarios by name."""
        return {
            name: replace(own, limits=limits_of(self.falls, own.limits))
            for name, own in load_scenarios(self.scenario).items()
        }

    @cached_property
    def policies(self) -> dict[str, Policies]:
        """Where each gait's policies are from, by the gait's name."""
        return {
            gait.name: find_policies(gait, self.source, self.robot, names=self.policy)
            for gait in self.gaits
        }

    @cached_property
    def controllers(self) -> dict[str, dict[str, AlternatingController]]:
        """What acts, by the gait's name and the policy's.

        Of several gaits, and of policies that are not named, those are taken that there are.

        Raises:
            InputError: if there is no such policy, or it is neural where students are asked for, or
                there is no expert where one is needed.
        """
        found = {}
        for gait in self.gaits:
            policies = self.policies[gait.name]
            names = policies.named(self.policy)
            if self.by_expert:
                # Raises where there is none, before anything is measured.
                _ = policies.expert
            if len(self.gaits) > 1 or self.policy == type(self).policy:
                names = tuple(own for own in names if own in (EXPERT, *policies.files)) or names
            found[gait.name] = policies.controllers(names)
            for name, controller in found[gait.name].items():
                if self.of_students and isinstance(controller.policy, NeuralPolicy):
                    raise InputError(
                        f"--policy {name}: {self.title} is of students; name a kind of student"
                    )
        return found

    @property
    def scenario_titles(self) -> dict[str, str]:
        """What people call each scenario."""
        return {name: scenario.title for name, scenario in self.scenarios.items()}

    def _gaits_to_measure(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Returns those gaits of which there are policies that are named.

        Raises:
            InputError: if there are none, a gait that is named has none, or files of one gait are
                named for several.
        """
        if self.mirrored:
            names = _with_mirror_image(names)
        if len(names) == 1:
            return names
        if self.source or any(map(is_file, self.policy)):
            raise InputError(
                "--gait: several gaits take no files of your own; name one gait for them"
            )
        kept = []
        for name in names:
            policies = self.policies_of(name, quiet=True)
            lacks = [own for own in self.policy if own not in (ALL, EXPERT, *policies.files)]
            if len(lacks) < len(self.policy):
                kept.append(name)
                if lacks:
                    say(f"{name}: has no policy {', '.join(lacks)}; the others are measured")
            elif ALL_GAITS not in self.gait:
                policies.file(lacks[0])
        if not kept:
            raise InputError(
                f"--policy {' '.join(self.policy)}: no gait ships with such a policy; name others, "
                "or one gait and the run with --source"
            )
        return tuple(kept)

    def _refuse(self) -> None:
        """Refuses what the experiment cannot be made of, before anything is made.

        Raises:
            InputError: if there are several scenarios or policies and one is asked for, or a
                scenario is continuous.
        """
        named = {"scenario": self.scenarios, "policy": max(self.controllers.values(), key=len)}
        for name in self.one:
            if len(named[name]) > 1:
                raise InputError(f"--{name}: {self.title} is of one {name}; name one")
        for name, scenario in self.scenarios.items():
            if self.discrete and scenario.accuracy is not None:
                raise InputError(
                    f"--scenario {name}: is continuous; name a scenario of discrete time"
                )

    def _inputs(self) -> dict[str, str]:
        """Returns digests of all that the run takes in, as its record holds them."""
        parts = [
            self.policies[gait.name].inputs(self.controllers[gait.name].items())
            for gait in self.gaits
        ]
        inputs = {key: " ".join(dict.fromkeys(part[key] for part in parts)) for key in parts[0]}
        inputs["scenario"] = " ".join(scenario.digest() for scenario in self.scenarios.values())
        return inputs | {name: getattr(self, digest) for name, digest in self.inputs.items()}

    def __getstate__(self) -> dict[str, Any]:
        """Leaves out what is found again where it is needed: workers are sent what cases hold."""
        kept = {*(own.name for own in fields(self)), *self.prepared, "_place"}
        return {name: value for name, value in vars(self).items() if name in kept}


@checked
class RolloutExperiment(Experiment):
    """Rolls robots out, and scores them.

    Attributes:
        n_steps: Control steps of a rollout.
        speed_range: Least and greatest commanded forward speed (m/s), in place of the scenario's
            commands.
    """

    n_steps: Count = EPISODE_STEPS
    speed_range: Range | None = None

    def rollouts(self, case: Case) -> RolloutConfig:
        """Returns how the robots of a case are rolled out."""
        return RolloutConfig(self.n_robots, self.n_steps, case.seed, 1, self.speed_range)

    def _refuse(self) -> None:
        """Refuses commands that a gait is not made for, too."""
        super()._refuse()
        config = RolloutConfig(speed_range=self.speed_range)
        for gait in self.gaits:
            for scenario in self.scenarios.values():
                refuse_commands(gait, scenario, config)


def _labelled(values: Any) -> list[tuple[Any, Any]]:
    """Returns the labels and values of an axis."""
    return [*values.items()] if isinstance(values, Mapping) else [(own, own) for own in values]


def _with_mirror_image(names: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the gaits that have a mirror image.

    Raises:
        InputError: if none has.
    """
    kept = []
    for name in names:
        if mirrored_states(find_gait(name)) is None:
            say(f"{name}: has no mirror image, since its machine favours a side; left out")
        else:
            kept.append(name)
    if not kept:
        raise InputError("--gait: no gait of these has a mirror image; name another")
    return tuple(kept)


def run_from_command_line(kind: type[Experiment]) -> None:
    """Runs an experiment of one's own by the settings of the command line."""
    take_signals()
    with report_errors():
        tyro.cli(kind, config=(tyro.conf.FlagCreatePairsOff,)).run()
