"""Importances of one gait's students: the samples, the measurement and its tables and maps."""

from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task import EPISODE_STEPS
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import symbols_of
from glassgait.studies.common.experiment import Report
from glassgait.studies.common.scores import interval
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.dataset import Dataset, load_rounds
from glassgait.studies.distillation.students import StudentKind, samples_folder
from glassgait.studies.importance.figures import importance_map
from glassgait.studies.importance.measures import (
    METHOD_TITLES,
    PAPER_TOP,
    is_described,
    merge_importances,
    observation_groups,
    permutation_importance,
    top_table,
)

N_VISITS = 8  # episodes in which a shipped student collects samples


def held_out_samples(folder: Path, kind: StudentKind, n_samples: int, seed: int) -> Dataset:
    """Draws at most `n_samples` samples from the episodes that a student was not fitted to."""
    data = load_rounds(samples_folder(folder, kind))
    return _drawn(data.subset(data.held_out), n_samples, seed)


def visited_samples(gait: Gait, controller: Controller, n_samples: int, seed: int) -> Dataset:
    """Draws samples from new episodes of one policy, in the nominal scenario."""
    data = collect(
        gait,
        controller,
        episodes=range(1, N_VISITS + 1),
        n_steps=min(EPISODE_STEPS, n_samples),
        worlds=Scenario(),
        generator=np.random.default_rng(seed),
        memories=controller.policy.remembers,
    )
    return _drawn(data, n_samples, seed)


def _drawn(data: Dataset, n_samples: int, seed: int) -> Dataset:
    n = len(data.episodes)
    chosen = np.random.default_rng(seed).choice(n, min(n_samples, n), replace=False)
    return data.subset(np.isin(np.arange(n), chosen))


def measure_importances(
    student: Policy, samples: Dataset, *, seed: int, repeats: int
) -> pd.DataFrame:
    """Measures a student's importances by permutation and by the method of its kind, if any.

    Returns one row per method, repeat, joint and observation.
    """
    # Measure the values by method (repeats, 12, n).
    generator = np.random.default_rng([seed, 1])
    importances = {"permutation": permutation_importance(student, samples, generator, repeats)}
    if (importance := student.importance(samples.observations)) is not None:
        method, values = importance
        importances[method] = values[None]

    # List them as rows.
    tables = []
    for method, values in importances.items():
        axes = [range(len(values)), quadruped.JOINTS, [*student.inputs]]
        index = pd.MultiIndex.from_product(axes, names=["repeat", "joint", "observation"])
        table = pd.DataFrame({"importance": values.ravel()}, index=index).reset_index()
        tables.append(table.assign(method=method))
    return pd.concat(tables, ignore_index=True)


def importance_report(gait: str, table: pd.DataFrame) -> Report:
    """Turns the rows of `measure_importances`, with a column `policy`, into tables and maps.

    The table `importances` has one row per student, method and group of observations;
    `top_observations` has the paper's beside them.
    """
    groups, tops = [], []
    tables: dict[str, pd.DataFrame] = {}
    figures: dict[str, Figure] = {}
    for keys, rows in table.groupby(["policy", "method"], sort=False):
        # Reshape the rows to an array (repeats, 12, n).
        kind, method = map(str, keys)
        names = tuple(dict.fromkeys(rows["observation"]))
        values = rows["importance"].to_numpy().reshape(-1, quadruped.N_JOINTS, len(names))
        mean, stem = values.mean(axis=0), f"{kind}_{method}"

        # Add a table and a map, the groups' importances, and the first three beside the paper's.
        title = f"{gait.capitalize()}, {kind}: {METHOD_TITLES[method]}"
        tables[stem] = pd.DataFrame(mean, columns=pd.Index(names)).assign(joint=quadruped.JOINTS)
        symbols = names if is_described(names[0]) else symbols_of(names)
        figures[stem] = importance_map(mean, symbols, title)
        groups.append(_by_group(values, names, kind, method))
        if method in PAPER_TOP:
            top = top_table(mean, names, gait, method)
            tops.append(top.assign(student=kind, method=method))
    tables["importances"] = pd.concat(groups, ignore_index=True)
    tables["top_observations"] = top = pd.concat(tops, ignore_index=True)
    return Report(
        tables=tables,
        metrics={"importances": tables["importances"].to_dict(orient="records")},
        figures=figures,
        shown={f"{gait}: the most important observations": top},
    )


def _by_group(values: Array, names: tuple[str, ...], policy: str, method: str) -> pd.DataFrame:
    """Sums importances (repeats, 12, n) over each group, and averages over joints."""
    merged = merge_importances(values, names).mean(axis=1)
    return pd.DataFrame(
        {
            "policy": policy,
            "method": method,
            "group": list(observation_groups(names)),
            "importance": merged.mean(axis=0),
            "importance_ci": [interval(pd.Series(column)) for column in merged.T],
        }
    )
