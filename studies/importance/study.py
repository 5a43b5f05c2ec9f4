"""Importances of one gait's students, without the closed loop: samples, tables and maps."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.models.arrays import Array
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import symbols_of
from glassgait.studies.common.console import say
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.scores import interval
from glassgait.studies.common.tables import to_latex
from glassgait.studies.distillation.collection import collect_alone
from glassgait.studies.distillation.students.dataset import Dataset, load_rounds
from glassgait.studies.distillation.students.library import samples_folder
from glassgait.studies.distillation.students.registry import student_title
from glassgait.studies.distillation.students.settings import StudentKind
from glassgait.studies.importance.figures import importance_map
from glassgait.studies.importance.measures import (
    METHOD_TITLES,
    PAPER_TOP,
    merge_importances,
    observation_groups,
    permutation_importance,
    top_table,
)

N_VISITS = 8
"""Episodes that a shipped student visits."""


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
    *,
    seed: int,
    repeats: int,
) -> tuple[pd.DataFrame, pd.DataFrame, Report]:
    """Measures every student's importances by every method.

    Args:
        gait: The gait.
        students: The students, by kind.
        samples: Held-out samples, by kind.
        seed: Seed of the shuffling.
        repeats: Shuffles of each observation.

    Returns:
        A row for each student, method and group of observations: `importance`, the mean of the
        joints, with its 95 % interval over shuffles. The most important observations of each
        student and joint type, beside the paper's. And all tables and maps.
    """
    groups, tops = [], []
    tables: dict[str, pd.DataFrame] = {}
    figures: dict[str, Figure] = {}
    for kind, student in students.items():
        say(f"shuffling the observations of {student_title(kind)}")
        names = student.observation_names
        generator = np.random.default_rng([seed, 1])
        found = {"permutation": permutation_importance(student, samples[kind], generator, repeats)}
        if (own_importance := student.capabilities.importance) is not None:
            method, own = own_importance(student, samples[kind].observations)
            found[method] = own[None]
        for method, values in found.items():
            mean, stem = values.mean(axis=0), f"{kind}_{method}"
            title = f"{gait.capitalize()}, {student_title(kind)}: {METHOD_TITLES[method]}"
            tables[stem] = _by_joint(mean, names)
            figures[stem] = importance_map(mean, symbols_of(names), title)
            groups.append(_by_group(values, names, kind, method))
            if method in PAPER_TOP:
                top = top_table(mean, names, gait, method)
                tops.append(top.assign(student=kind, method=method))
    top = pd.concat(tops, ignore_index=True)
    tables["top_observations"] = top
    files = {"top_observations.tex": to_latex(top)}
    report = Report(tables=tables, figures=figures, files=files)
    return pd.concat(groups, ignore_index=True), top, report


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
