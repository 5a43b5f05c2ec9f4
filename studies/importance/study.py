"""The importance study of one gait, without the closed loop: tables and figures by student."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.files import write_atomically
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.studies.common.console import say
from glassgait.studies.common.figures import save_figure
from glassgait.studies.common.scores import interval
from glassgait.studies.common.tables import to_latex, write_table
from glassgait.studies.distillation.collection import collect_alone
from glassgait.studies.distillation.students.dataset import Dataset, load_rounds
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.distillation.students.settings import StudentKind
from glassgait.studies.importance.figures import (
    importance_map,
)
from glassgait.studies.importance.measures import (
    METHOD_TITLES,
    PAPER_TOP,
    merge_importances,
    observation_groups,
    permutation_importance,
    top_table,
)

N_VISITS = 8
"""Episodes that a shipped student visits, twice each of the speeds of a distillation."""


def held_out_samples(folder: Path, kind: StudentKind, n_samples: int, seed: int) -> Dataset:
    """Draws samples from the episodes that a student was not fitted to.

    Args:
        folder: Folder of the distillation.
        kind: Kind of student.
        n_samples: Number of samples, at most.
        seed: Seed of the drawing.
    """
    data = load_rounds(samples_folder(folder, kind))
    return _drawn(data.subset(data.held_out), n_samples, seed)


def visited_samples(
    gait: Gait, expert: NeuralPolicy, student: Policy, n_samples: int, seed: int
) -> Dataset:
    """Draws samples from new episodes of a student that acts alone, in the training scenario.

    Args:
        gait: The gait.
        expert: The expert.
        student: The student.
        n_samples: Number of samples, at most.
        seed: Seed of the episodes and of the drawing.

    Raises:
        InputError: if a sample is not finite.
    """
    data = collect_alone(gait, expert, student, n_robots=N_VISITS, n_steps=EPISODE_STEPS, seed=seed)
    return _drawn(data, n_samples, seed)


def _drawn(data: Dataset, n_samples: int, seed: int) -> Dataset:
    n = len(data.episodes)
    chosen = np.random.default_rng(seed).choice(n, min(n_samples, n), replace=False)
    return data.subset(np.isin(np.arange(n), chosen))


def measure_importances(
    gait: str,
    students: Mapping[str, Policy],
    samples: Mapping[str, Dataset],
    folder: Path,
    *,
    seed: int,
    repeats: int,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Measures every student's importances by every method, and writes maps and tables.

    Args:
        gait: The gait.
        students: The students, by kind.
        samples: Held-out samples, by kind.
        folder: Where tables and figures go.
        seed: Seed of the shuffling.
        repeats: Shuffles of each observation.

    Returns:
        A row for each student, method and group of observations: `importance`, the mean of the
        joints, with its 95 % interval over shuffles. And the most important observations of each
        student and joint type, beside the paper's.
    """
    tables, tops = [], []
    for kind, student in students.items():
        say(f"shuffling the observations of {student_title(kind)}")
        names = student.observation_names
        generator = np.random.default_rng([seed, 1])
        found = {"permutation": permutation_importance(student, samples[kind], generator, repeats)}
        if (own_importance := student.capabilities.importance) is not None:
            method, own = own_importance(student, samples[kind].observations)
            found[method] = own[None]
        for method, values in found.items():
            mean = values.mean(axis=0)
            stem = folder / f"{kind}_{method}"
            title = f"{gait.capitalize()}, {student_title(kind)}"
            write_table(_by_joint(mean, names), stem)
            save_figure(importance_map(mean, names, f"{title}: {METHOD_TITLES[method]}"), stem)
            tables.append(_by_group(values, names, kind, method))
            if method in PAPER_TOP:
                top = top_table(mean, names, gait, method)
                tops.append(top.assign(student=kind, method=method))
    every_top = pd.concat(tops, ignore_index=True)
    write_table(every_top, folder / "top_observations")
    write_atomically(folder / "top_observations.tex", to_latex(every_top))
    return pd.concat(tables, ignore_index=True), every_top


def _by_joint(importances: Array, names: tuple[str, ...]) -> pd.DataFrame:
    return pd.DataFrame(importances, columns=pd.Index(names)).assign(joint=quadruped.JOINTS)


def _by_group(values: Array, names: tuple[str, ...], policy: str, method: str) -> pd.DataFrame:
    """Adds importances (repeats, 12, n) up over each group, and averages over joints."""
    merged = merge_importances(values, names).mean(axis=1)
    return pd.DataFrame(
        {
            "policy": policy,
            "method": method,
            "without": list(observation_groups(names)),
            "importance": merged.mean(axis=0),
            "importance_ci": [interval(pd.Series(column)) for column in merged.T],
        }
    )
