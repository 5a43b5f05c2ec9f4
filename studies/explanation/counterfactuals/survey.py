"""Many questions of one policy: how long answers take, and how much they change."""

import time

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.counterfactuals.question import Question, Room, search_of
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.studies.common.console import progress_bar

COLUMNS = (
    "joint",
    "step",
    "by",
    "distance",
    "gap",
    "changed",
    "fewest",
    "seconds",
    "fewest_seconds",
)


def ask_many(
    policy: Policy, observations: Array, room: Room, *, count: int, by: float, seed: int
) -> pd.DataFrame:
    """Asks questions of random moments and joints, up and down by turns.

    Args:
        policy: The policy.
        observations: What it observed (m, n).
        room: What may be observed instead.
        count: Number of questions.
        by: By how much the target is to change (rad), either way.
        seed: Seed of moments and joints.

    Returns:
        A row a question, with `COLUMNS`: the nearest answer's distance (spreads), gap and number of
        observations that it changes, NaN where there is none; how many change at `fewest`, NaN for
        more than two; and the processor's time of both answers (s).
    """
    generator = np.random.default_rng(seed)
    steps = generator.integers(len(observations), size=count)
    joints = generator.integers(quadruped.N_JOINTS, size=count)
    rows = []
    with progress_bar(count) as (progress, task):
        for number, (joint, step) in enumerate(zip(joints.tolist(), steps.tolist(), strict=True)):
            way = abs(by) * (1 if number % 2 == 0 else -1)
            question = Question(policy, joint, observations[step], way, room)
            rows.append((quadruped.JOINTS[joint], step, way, *_asked(question)))
            progress.update(task, advance=1, text=f"{number + 1} questions")
    return pd.DataFrame(rows, columns=list(COLUMNS))


def _asked(question: Question) -> tuple[float, ...]:
    start = time.process_time()
    search = search_of(question)
    nearest = search.nearest()
    middle = time.process_time()
    fewest = search.fewest()
    end = time.process_time()
    found = (np.nan, np.nan, np.nan)
    if nearest is not None:
        found = (nearest.distance, nearest.gap, len(nearest.changed))
    few = np.nan if fewest is None else len(fewest.changed)
    return *found, few, middle - start, end - middle


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Sums up the questions in one row, under what people call the columns."""
    nearest = table.dropna(subset=["distance"])
    return pd.DataFrame(
        [
            {
                "questions": len(table),
                "answered": len(nearest),
                "largest gap": float(nearest["gap"].max()),
                "median time (s)": float(table["seconds"].median()),
                "longest (s)": float(table["seconds"].max()),
                "median of fewest (s)": float(table["fewest_seconds"].median()),
                "median distance": float(nearest["distance"].median()),
                "observations, nearest": float(nearest["changed"].median()),
                "one is enough": int((table["fewest"] == 1).sum()),
                "two are": int((table["fewest"] == 2).sum()),
                "more": int(table["fewest"].isna().sum()),
            }
        ]
    )
