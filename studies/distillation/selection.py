"""Which of several students earns most alone: what R² does not tell."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd
from joblib import Parallel, delayed

from models.a1 import robot
from models.policies.neural import NeuralPolicy
from models.policies.policy import Policy
from models.task import EPISODE_STEPS
from models.task.gait import Gait
from studies.evaluation.config import WORLDS, RolloutConfig
from studies.evaluation.rollouts import roll_out
from studies.evaluation.scores import score_rollouts, summarize
from studies.evaluation.team import Team

ENOUGH = 0.99
"""Share of the best student's reward that a simpler one must earn to be preferred."""

SELECTION_SEEDS = (500, 501)
"""Seeds of the rollouts that select, none of those that evaluate."""


def rank_alone(
    candidates: Mapping[str, Policy],
    gait: Gait,
    expert: NeuralPolicy,
    n_steps: int = EPISODE_STEPS,
    n_jobs: int = 1,
) -> pd.DataFrame:
    """Rolls every candidate out alone and ranks them by reward.

    Args:
        candidates: Students by label.
        gait: The gait.
        expert: The expert, for its estimator.
        n_steps: Control steps of a rollout.
        n_jobs: Candidates that are rolled out at once.

    Returns:
        A row a candidate, the best first, with its means over 52 robots.
    """
    config = RolloutConfig(n_steps=n_steps).at_distilled_speeds(gait)
    runs = [(label, seed) for label in candidates for seed in SELECTION_SEEDS]
    logs = Parallel(n_jobs=n_jobs)(
        delayed(roll_out)(
            gait,
            Team(expert, candidates[label], 0),
            WORLDS["training"],
            replace(config, seed=seed),
        )
        for label, seed in runs
    )
    scores = [
        score_rollouts(log, robot.MASS).assign(candidate=label)
        for (label, _), log in zip(runs, logs, strict=True)
    ]
    means = summarize(pd.concat(scores, ignore_index=True), ["candidate"])
    return means.sort_values("reward", ascending=False, ignore_index=True, kind="stable")


def simplest_of_the_best(ranked: pd.DataFrame, simplest_first: Sequence[str]) -> str:
    """Returns the simplest candidate that falls no more often than the best and earns enough.

    Args:
        ranked: What `rank_alone` returned.
        simplest_first: Every candidate, the simplest first.
    """
    best = ranked.iloc[0]
    earns = ranked["reward"] >= best["reward"] - (1.0 - ENOUGH) * abs(best["reward"])
    good = set(ranked.loc[earns & (ranked["falls"] <= best["falls"]), "candidate"])
    return next(candidate for candidate in simplest_first if candidate in good)
