"""The symmetry study of one gait: the tables of every policy, where the expert goes."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.symmetry import Reflection
from glassgait.studies.common.console import say
from glassgait.studies.distillation.students.dataset import Dataset
from glassgait.studies.distillation.students.library import load_shipped_students, load_students
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.evaluation.symmetry.measures import (
    drawn_importances,
    left_right_table,
    mirror_r2,
)

RESAMPLES = 1000
"""Draws of robots that the interval of an R² is of."""


def policies_of(
    expert: NeuralPolicy, distillation: Path | None, *, shipped: bool
) -> dict[str, Policy]:
    """Returns the expert and its students, by name.

    Args:
        expert: The expert.
        distillation: Folder of the distillation whose students are taken.
        shipped: Whether the expert is the one that ships; without a folder its students are those
            that ship with it, and those of another expert none.

    Raises:
        InputError: if the folder holds no students, or one does not fit the expert.
    """
    students: Mapping[str, Policy] = {}
    if distillation is not None:
        students = load_students(distillation, expert)
    elif shipped:
        students = load_shipped_students(expert)
    return {"expert": expert, **students}


def measure_symmetry(
    policies: Mapping[str, Policy],
    samples: Dataset,
    reflect: Reflection,
    *,
    seed: int,
    n_samples: int,
    repeats: int,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Measures every policy on the same samples.

    Args:
        policies: The policies, by name.
        samples: What `visit` returned of the expert.
        reflect: The mirror of observations.
        seed: Seed of drawing and shuffling.
        n_samples: Samples of a repeat of importances.
        repeats: Repeats of importances.

    Returns:
        A row a policy: `r2` of its mirror image against itself, the ends `r2_low` and `r2_high` of
        its 95 % interval, `left_share` of all importance of legs, and of how many `pairs` left and
        right `agree`. And the rows of `left_right_table` of every policy.
    """
    rows, tables = [], []
    for name, policy in policies.items():
        say(f"mirroring {student_title(name)}")
        # Every policy meets the same draws.
        r2, low, high = mirror_r2(
            policy, samples, reflect, np.random.default_rng([seed, 1]), RESAMPLES
        )
        importances = drawn_importances(
            policy,
            samples,
            np.random.default_rng([seed, 2]),
            n_samples=n_samples,
            repeats=repeats,
        )
        table = left_right_table(importances, policy.observation_names, reflect)
        left, right = table["left"].sum(), table["right"].sum()
        rows.append(
            {
                "policy": name,
                "r2": r2,
                "r2_low": low,
                "r2_high": high,
                "left_share": left / (left + right) if left + right > 0 else float("nan"),
                "agree": int(table["agree"].sum()),
                "pairs": len(table),
            }
        )
        tables.append(table.assign(policy=name)[["policy", *table.columns]])
    return pd.DataFrame(rows), pd.concat(tables, ignore_index=True)


def titled(table: pd.DataFrame) -> pd.DataFrame:
    """Returns the table of policies for reading."""
    intervals = zip(table["r2"], table["r2_low"], table["r2_high"], strict=True)
    agreeing = zip(table["agree"], table["pairs"], strict=True)
    return pd.DataFrame(
        {
            "policy": table["policy"].map(student_title),
            "R² in the mirror": [
                f"{r2:.3f} ({low:.3f} to {high:.3f})" for r2, low, high in intervals
            ],
            "left share of importance": table["left_share"].round(3),
            "left and right agree": [f"{agree} of {pairs}" for agree, pairs in agreeing],
        }
    )
