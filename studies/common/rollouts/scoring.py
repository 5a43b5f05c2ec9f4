"""Rollouts as cases: robots of one seed, rolled out and scored."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd

from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.controller import Controller
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case, run_cases, slow_first
from glassgait.studies.common.console import say
from glassgait.studies.common.rollouts.config import (
    SELECTION_SEEDS,
    RolloutConfig,
    refuse_to_report,
)
from glassgait.studies.common.rollouts.roll_out import roll_out
from glassgait.studies.common.scores import SCORES, score_rollouts


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
    cases = [
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
    for case in cases:
        refuse_commands(case)
    return cases


def cases_in_worlds(
    gait: Gait,
    controllers: Mapping[str, Controller],
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
) -> list[Case]:
    """Lists the rollouts of every policy in every scenario, the slow ones first.

    In a scenario all policies meet the same initial states, commands and noise, at the speeds of
    distillation unless the settings or the scenario name others: robots can be compared in pairs.
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
            config.at_distilled_speeds(gait, scenario),
        )
    ]


def refuse_commands(case: Case) -> None:
    """Refuses a rollout whose commands the gait is not made for.

    Raises:
        InputError: if a speed is beyond the gait's, or the scenario's command is.
    """
    case.config.refuse_speeds_beyond(case.gait)
    case.config.commanding(case.scenario).command.check(case.gait)


def for_selection(cases: Sequence[Case]) -> list[Case]:
    """Returns the cases once each, of whatever seeds they were, with a seed that selects."""
    seed = SELECTION_SEEDS[0]
    return [
        replace(
            case,
            labels={**case.labels, "seed": seed},
            seed=seed,
            config=replace(case.config, seed=seed),
        )
        for case in cases
        if case.seed == cases[0].seed
    ]


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
