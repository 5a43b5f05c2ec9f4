"""Cases: pieces of work that are done side by side, each kept as soon as it is done."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pandas as pd
from joblib import delayed

from glassgait.diagrams.scenario import Scenario
from glassgait.models.files import read_record, write_record
from glassgait.models.policies.controller import AlternatingController, Controller, alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.alternation import ratio_title
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import progress_bar, say
from glassgait.studies.common.episode import Event, episode
from glassgait.studies.common.observers import Log, RolloutLog
from glassgait.studies.common.parallel.loop import run_parallel
from glassgait.studies.common.rollouts import (
    RolloutConfig,
    refuse_to_report,
    roll_out,
)
from glassgait.studies.common.run_folder import to_plain
from glassgait.studies.common.scores import SCORES, score_rollouts


@dataclass(frozen=True)
class Case:
    """What is measured at once: a controller in a scenario, with a seed.

    Attributes:
        labels: Columns that distinguish the case's rows from the others'.
        gait: The gait.
        controller: What acts.
        scenario: Where.
        seed: Seed of all that is drawn.
        config: Further settings of the measurement, a dataclass or plain values.
        scores: Names of what is measured, where an earlier version measured something else.
        values: What the labels of an experiment's axes stand for.
    """

    labels: dict[str, Any]
    gait: Gait
    controller: Controller
    scenario: Scenario
    seed: int
    config: Any = None
    scores: tuple[str, ...] = ()
    values: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What progress and files call it."""
        return "_".join(map(_short, self.labels.values())).replace("/", "-")

    @property
    def alone(self) -> AlternatingController:
        """The controller, where a policy acts alone or two by turns."""
        assert isinstance(self.controller, AlternatingController)
        return self.controller

    def roll_out(self, n_robots: int, n_steps: int, *, events: Sequence[Event] = ()) -> RolloutLog:
        """Rolls robots out in an episode of discrete time, and returns what they did."""
        log = Log(self.controller, self.scenario)
        episode(
            self.gait,
            self.controller,
            self.scenario,
            n_robots=n_robots,
            n_steps=n_steps,
            seed=self.seed,
            observers=[log],
            events=events,
        )
        return log.rollout(n_steps)

    def digest(self) -> str:
        """Returns a digest that differs between cases that would not give the same table."""
        own = self.controller
        config = self.config.digest() if hasattr(self.config, "digest") else to_plain(self.config)
        settings = [self.gait.digest(), self.scenario.digest(), self.seed, config]
        policies = [policy.digest() for policy in (own.expert, own.student) if policy is not None]
        values = [value.digest() for value in self.values.values() if hasattr(value, "digest")]
        whole = [*settings, self.scores, own.settings(), *policies, *values]
        return hashlib.sha256(json.dumps(whole).encode()).hexdigest()[:16]

    def with_config(self, config: Any) -> "Case":
        """Returns the case with other settings of the measurement."""
        return replace(self, config=config)


def _short(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


Measure = Callable[[Case], pd.DataFrame]


def run_cases(
    cases: Sequence[Case],
    measure: Measure,
    folder: Path,
    *,
    of: str = "",
    processes: int | None = None,
) -> pd.DataFrame:
    """Measures every case side by side, but for those whose tables the folder holds already.

    Args:
        cases: The cases, the slowest best first.
        measure: Measures one of them, in whichever process.
        folder: Where each case's table is kept as soon as it is done.
        of: What else distinguishes the tables of a run from those of another.
        processes: Cases at once; by default as many as there are cores, or the cluster has.

    Returns:
        The tables with their labels, in the order of the cases.

    Raises:
        InputError: if a table that the folder holds is damaged.
    """
    paths = [folder / f"{case.name}.{case.digest()}.json" for case in cases]
    names = [f"{of} {path.stem}".strip() for path in paths]
    kept = {
        i: pd.DataFrame(read_record(path, of=names[i]))
        for i, path in enumerate(paths)
        if path.exists()
    }
    pending = [i for i in range(len(cases)) if i not in kept]
    processes = max(1, min(processes or len(pending), len(pending)))
    work = (delayed(_numbered)(i, measure, cases[i]) for i in pending)
    with progress_bar(len(cases), len(cases) - len(pending)) as (progress, bar):
        for i, table in run_parallel(work, processes, in_order=False):
            values = table.to_dict(orient="list")
            write_record(paths[i], values, of=names[i])
            kept[i] = pd.DataFrame(values)
            progress.update(bar, advance=1, text=cases[i].name)
    tables = [_labelled(case, kept[i]) for i, case in enumerate(cases) if len(kept[i])]
    return pd.concat(tables, ignore_index=True)


def _numbered(index: int, measure: Measure, case: Case) -> tuple[int, pd.DataFrame]:
    return index, measure(case)


def _labelled(case: Case, table: pd.DataFrame) -> pd.DataFrame:
    labels = pd.DataFrame(dict.fromkeys(case.labels), index=table.index)
    for name, value in case.labels.items():
        labels[name] = value
    return pd.concat([labels, table], axis=1)


def digests_of(cases: Iterable[Case]) -> dict[str, str]:
    """Returns digests of all that cases take in, as a run's record holds them."""
    every = list(cases)
    digests = {
        "gait": [case.gait.digest() for case in every],
        "expert": [case.controller.expert.digest() for case in every],
        "scenario": [case.scenario.digest() for case in every],
        "policies": [
            f"{case.labels.get('policy', '')} {own.digest()}".strip()
            for case in every
            for own in case.controller.policies.values()
        ],
    }
    return {name: " ".join(dict.fromkeys(own)) for name, own in digests.items()}


def slow_first(scenarios: Mapping[str, Scenario]) -> list[tuple[str, Scenario]]:
    """Returns scenarios by name, the slow ones first: few robots are rolled out there."""
    return sorted(scenarios.items(), key=lambda item: item[1].max_robots or math.inf)


def rollout_cases(
    labels: Mapping[str, Any],
    gait: Gait,
    controller: Controller,
    scenario: Scenario,
    config: RolloutConfig,
) -> list[Case]:
    """Lists the rollouts of a controller in a scenario, one for each seed.

    Raises:
        InputError: if one of the seeds is kept for selection, or the gait is not made for what is
            commanded.
    """
    refuse_to_report(config.seeds)
    refuse_commands(gait, scenario, config)
    return [
        Case(
            {**labels, "seed": seed},
            gait,
            controller,
            scenario,
            seed,
            replace(config, seed=seed, n_seeds=1),
            SCORES,
        )
        for seed in config.seeds
    ]


def cases_in_worlds(
    gait: Gait,
    controllers: Mapping[str, Controller],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
) -> list[Case]:
    """Lists the rollouts of every policy in every scenario, the slow ones first.

    In a scenario all policies meet the same initial states, commands and noise: robots can be
    compared in pairs.
    """
    return [
        case
        for name, scenario in slow_first(scenarios)
        for policy, controller in controllers.items()
        for case in rollout_cases(
            {"policy": policy, "scenario": name},
            gait,
            controller,
            scenario,
            config,
        )
    ]


def refuse_commands(gait: Gait, scenario: Scenario, config: RolloutConfig) -> None:
    """Refuses rollouts whose commands a gait is not made for.

    Raises:
        InputError: if a speed is beyond the gait's, or the scenario's command is.
    """
    config.refuse_speeds_beyond(gait)
    config.commanding(scenario).command.check(gait)


def score(case: Case) -> pd.DataFrame:
    """Rolls the robots of a case out, and returns their scores, a row a robot."""
    log = roll_out(case.gait, case.controller, case.scenario, case.config)
    return score_rollouts(log, case.controller.robot.mass + case.scenario.station.payload)


def run_rollouts(
    cases: Sequence[Case], folder: Path, *, processes: int | None = None
) -> pd.DataFrame:
    """Rolls out and scores every case, but for those whose scores the folder holds already.

    Args:
        cases: The cases, the slowest best first.
        folder: Where each case's scores are kept as soon as it is done.
        processes: Rollouts at once; by default as many as there are cores, or the cluster has.

    Returns:
        Scores, a row a robot, in the order of the cases, with their labels and the seed.

    Raises:
        InputError: if scores that the folder holds are damaged.
    """
    scores = run_cases(cases, score, folder, processes=processes)
    for line in not_finite_lines(scores):
        say(line)
    return scores


def not_finite_lines(scores: pd.DataFrame) -> list[str]:
    """Says where a policy gave no action: among the falls, it would look like any other."""
    lines = []
    lost = scores[scores["not_finite"] != ""]
    labels = list(scores.columns[: scores.columns.get_loc("robot")])
    for keys, own in lost.groupby(labels, sort=False):
        first = own.sort_values("steps").iloc[0]
        lines.append(
            f"{' '.join(map(str, keys))}: the action of {first['not_finite']} is not finite at "
            f"control step {first['steps'] - 1}, robot {first['robot']}; so it is for {len(own)} "
            "robots, which count as fallen"
        )
    return lines


PERIODS = (1, 2, 4, 6, 8, 0)
"""Control steps from one action of the expert to the next: ratios 1, 1/2, 1/4, 1/6, 1/8 and 0."""


def alternation_cases(
    gait: Gait,
    expert: NeuralPolicy,
    students: Mapping[str, Policy],
    config: RolloutConfig,
    periods: tuple[int, ...] = PERIODS,
    scenario: Scenario | None = None,
) -> list[Case]:
    """Lists the rollouts of every student at every ratio, in the training world by default.

    All meet the same initial states, commands and noise. At ratio 1 the expert acts alone, so it
    is rolled out once.
    """
    scenario = scenario or Scenario()
    policies = {("expert", 1): alone(expert)}
    for kind, student in students.items():
        for period in periods:
            if period != 1:
                policies[kind, period] = AlternatingController(expert, student, period)
    return [
        job
        for (kind, period), policy in policies.items()
        for job in rollout_cases(
            {"policy": kind, "ratio": ratio_title(period)},
            gait,
            policy,
            scenario,
            config,
        )
    ]
