"""Selection of the best of several students by rollouts, since R² does not predict falls."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pandas as pd
from joblib import delayed

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.policies.controller import alone
from glassgait.models.policies.policy import Policy
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.terrain import Terrain
from glassgait.studies.common.experiment import SELECTION_SEEDS
from glassgait.studies.common.jobs import run_parallel
from glassgait.studies.common.rollouts import RolloutConfig, score
from glassgait.studies.common.scores import summarize

MIN_RETURN_SHARE = 0.97
"""Share of the best return below which a candidate is dropped, however rarely it falls."""

SIMPLICITY_RETURN_SHARE = 0.99
"""Share of the best return among those with the fewest falls that a simpler candidate needs."""

ROUGH = Scenario(
    "rough",
    StationConfig(friction=0.6, payload=1.5, terrain=Terrain(slope=15.0)),
    heading=180.0,
    latency=0.01,
    push_speed=1.0,
    push_interval=5.0,
)
"""A scenario with many falls: a slope, low friction, a load, latency and pushes at once."""

SELECTION = tuple(zip(SELECTION_SEEDS, (Scenario(), ROUGH), strict=False))
"""Seeds and scenarios of the rollouts."""


def rank_candidates(
    candidates: Mapping[str, Policy], gait: Gait, expert: Policy, n_steps: int = EPISODE_STEPS
) -> pd.DataFrame:
    """Ranks the candidates by their mean return without the expert, best first.

    The mean is over 52 robots, half in the nominal scenario and half in a rough one.
    """
    config = RolloutConfig(n_steps=n_steps)
    runs = [(label, seed, scenario) for label in candidates for seed, scenario in SELECTION]
    work = (
        delayed(score)(gait, alone(candidates[label], expert), scenario, replace(config, seed=seed))
        for label, seed, scenario in runs
    )
    scores = [
        table.assign(candidate=label)
        for (label, _, _), table in zip(runs, run_parallel(work), strict=True)
    ]
    means = summarize(pd.concat(scores, ignore_index=True), ["candidate"])
    return means.sort_values("return", ascending=False, ignore_index=True, kind="stable")


def simplest_of_the_best(ranked: pd.DataFrame, complexity: Mapping[str, Any]) -> str:
    """Chooses the simplest of the candidates with the fewest falls and a high return.

    Of equally complex candidates, the one with the greatest return is chosen. `ranked` is the
    result of `rank_candidates`; complexities are of any ordered type.
    """
    # Drop candidates with a low return, then those with more falls.
    able = _within(ranked, MIN_RETURN_SHARE)
    steady = _within(able[able["falls"] == able["falls"].min()], SIMPLICITY_RETURN_SHARE)
    return min(steady["candidate"], key=lambda candidate: complexity[candidate])


def _within(ranked: pd.DataFrame, share: float) -> pd.DataFrame:
    best = ranked["return"].max()
    return ranked[ranked["return"] >= best - (1.0 - share) * abs(best)]
