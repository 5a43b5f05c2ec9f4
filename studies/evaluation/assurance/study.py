"""The study: a calibration in distribution, then rollouts in every world."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from glassgait.diagrams.scenario import Scenario
from glassgait.models.files import record_or_made
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.controller import (
    AlternatingController,
    AssuredController,
    Controller,
    alone,
)
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.assurance import EnsembleDisagreement, Hysteresis, Region
from glassgait.models.task.gait import Gait
from glassgait.studies.common.cases import Case
from glassgait.studies.common.rollouts.config import RolloutConfig
from glassgait.studies.common.rollouts.scoring import cases_in_worlds, run_rollouts
from glassgait.studies.evaluation.assurance.calibration import (
    REGION_TITLES,
    RegionKind,
    Visits,
    choose_hysteresis,
    joined,
    make_regions,
    visit,
)
from glassgait.studies.evaluation.assurance.fall_prediction import (
    prediction_row,
    rescues,
    warnings_of,
)


@dataclass(frozen=True)
class Pair:
    """An expert and its student.

    Attributes:
        gait: Their gait.
        expert: Acts out of it.
        student: Acts in distribution.
        name: The student's kind.
    """

    gait: Gait
    expert: NeuralPolicy
    student: Policy
    name: str

    @property
    def alone(self) -> dict[str, AlternatingController]:
        """Both alone, by name."""
        student = alone(self.student, self.expert)
        return {"expert": alone(self.expert), self.name: student}


@dataclass(frozen=True)
class Calibration:
    """What was chosen in distribution, and what it predicts.

    Attributes:
        region: Where the student may act.
        hysteresis: Limits, by the share of steps in distribution that the expert is called in.
        fall_prediction: How each kind of region predicts falls under pushes, a row a kind and
            share.
        warnings: A row a fall under pushes.
        rescues: How late a fall can be averted, a row a lead.
    """

    region: Region
    hysteresis: dict[float, Hysteresis]
    fall_prediction: pd.DataFrame
    warnings: pd.DataFrame
    rescues: pd.DataFrame

    def to_plain(self) -> dict[str, Any]:
        """Returns it as values that JSON can hold."""
        disagreement = self.region.disagreement
        tables = (self.fall_prediction, self.warnings, self.rescues)
        return {
            "corners": [self.region.lower.tolist(), self.region.upper.tolist()],
            "usual_disagreement": disagreement.usual.tolist() if disagreement else None,
            "hysteresis": [
                [calls, own.limit, own.return_limit, own.return_steps]
                for calls, own in self.hysteresis.items()
            ],
            "tables": [table.to_dict(orient="list") for table in tables],
        }

    @staticmethod
    def from_plain(values: dict[str, Any], student: Policy) -> "Calibration":
        """Rebuilds what `to_plain` took apart, of the student that it was made with."""
        lower, upper = np.array(values["corners"])
        disagreement = None
        if isinstance(student, AdditivePolicy) and values["usual_disagreement"] is not None:
            disagreement = EnsembleDisagreement(
                student.disagreement, np.array(values["usual_disagreement"])
            )
        region = Region(student.observation_names, lower, upper, disagreement)
        limits = {calls: Hysteresis(*own) for calls, *own in values["hysteresis"]}
        tables = [pd.DataFrame(table) for table in values["tables"]]
        return Calibration(region, limits, *tables)


def calibrate(
    pair: Pair,
    nominal: Visits,
    pushed: Visits,
    world: Scenario,
    *,
    calls: tuple[float, ...],
    quantile: float,
    return_steps: int,
    disagreement: bool,
    seed: int,
) -> Calibration:
    """Chooses region and limits by what is visited in distribution, and tries what they predict.

    Args:
        pair: An expert and its student.
        nominal: Where the student alone and the expert alone were in distribution.
        pushed: Where the student alone was under pushes.
        world: The world of the pushes.
        calls: Shares of steps in distribution in which the expert may be called.
        quantile: Share of observations that each end of a range leaves out.
        return_steps: Control steps inside after which the student acts again.
        disagreement: Whether the student's models must agree as they do in distribution, too.
        seed: Seed of the noise in rescues.
    """
    regions = make_regions(pair.gait, pair.student, nominal, quantile)
    watched: RegionKind = "states_and_disagreement" if disagreement else "states"
    chosen: dict[float, Hysteresis] = {}
    rows = []
    for kind, own in regions.items():
        overrun = own.overrun(nominal.observation)
        for share in calls:
            hysteresis = choose_hysteresis(overrun, nominal.alive, share, return_steps)
            row = {"region": REGION_TITLES[kind], "calls": share}
            rows.append(row | prediction_row(nominal, pushed, own, hysteresis))
            if kind == watched:
                chosen[share] = hysteresis
    region = regions[watched]
    averted, alone = (
        rescues(pair.gait, policy, world, pushed, seed) for policy in pair.alone.values()
    )
    averted = averted.assign(alone=alone["rescued"])
    warnings = warnings_of(pushed, region, chosen[max(calls)])
    return Calibration(region, chosen, pd.DataFrame(rows), warnings, averted)


def calibrate_once(
    pair: Pair,
    worlds: tuple[Scenario, Scenario],
    configs: tuple[RolloutConfig, RolloutConfig],
    path: Path,
    *,
    of: str,
    calls: tuple[float, ...],
    quantile: float,
    return_steps: int,
    disagreement: bool,
) -> Calibration:
    """Calibrates with robots in distribution and under pushes, unless the file holds the outcome.

    Args:
        pair: An expert and its student.
        worlds: The training scenario, and the world of the pushes.
        configs: How robots are rolled out in each.
        path: Where the calibration is kept.
        of: What identifies the run.
        calls: See `calibrate`.
        quantile: See `calibrate`.
        return_steps: See `calibrate`.
        disagreement: See `calibrate`.
    """

    def made() -> dict[str, Any]:
        # Where the expert walks in distribution the student may take over again: without
        # those visits the expert, once called, would hardly ever hand back.
        nominal = joined(
            [visit(pair.gait, policy, worlds[0], configs[0]) for policy in pair.alone.values()]
        )
        pushed = visit(pair.gait, pair.alone[pair.name], worlds[1], configs[1])
        return calibrate(
            pair,
            nominal,
            pushed,
            worlds[1],
            calls=calls,
            quantile=quantile,
            return_steps=return_steps,
            disagreement=disagreement,
            seed=configs[1].seed,
        ).to_plain()

    kept = record_or_made(path, made, of=of)
    return Calibration.from_plain(kept, pair.student)


def assured_name(calls: float) -> str:
    """Names the assured policy whose expert may be called in a share of steps in distribution."""
    return f"assured_{calls:g}"


def scheduled_name(calls: float) -> str:
    """Names the schedule with as many calls as that policy."""
    return f"schedule_{calls:g}"


def assured_policies(pair: Pair, calibration: Calibration) -> dict[str, Controller]:
    """Returns the expert, the student alone, and the student under assurance, by name."""
    assured = {
        assured_name(calls): AssuredController(
            pair.expert, pair.student, calibration.region, hysteresis
        )
        for calls, hysteresis in calibration.hysteresis.items()
    }
    return {**pair.alone, **assured}


def roll_out_all(
    pair: Pair,
    calibration: Calibration,
    scenarios: Mapping[str, Scenario],
    config: RolloutConfig,
    folder: Path,
    processes: int | None,
) -> pd.DataFrame:
    """Rolls out every controller in every world, the schedules last, with as many calls.

    Returns:
        Scores, a row a robot.
    """
    jobs = cases_in_worlds(pair.gait, assured_policies(pair, calibration), scenarios, config)
    scores = run_rollouts(jobs, folder, processes=processes)
    scheduled: list[Case] = []
    for name, scenario in scenarios.items():
        own = scores[scores["scenario"] == name]
        policies: dict[str, Controller] = {}
        for calls in calibration.hysteresis:
            called = _share_called(own[own["policy"] == assured_name(calls)])
            schedule = AlternatingController(pair.expert, pair.student, period_of(called))
            policies[scheduled_name(calls)] = schedule
        scheduled += cases_in_worlds(pair.gait, policies, {name: scenario}, config)
    return pd.concat(
        [scores, run_rollouts(scheduled, folder, processes=processes)], ignore_index=True
    )


def period_of(called: float) -> int:
    """Returns the period of a schedule that calls the expert as often, or a little more often."""
    return math.floor(1.0 / called) if called > 0.0 else 0


def _share_called(scores: pd.DataFrame) -> float:
    """Returns the share of all robots' steps, so that robots that fell early count for less."""
    return float(np.average(scores["expert_share"], weights=scores["steps"]))
