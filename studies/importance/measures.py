"""Importances: permutation, groups of observations, and the table beside the paper's."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.files import read_yaml
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entry_of, indices_of
from glassgait.studies.distillation.dataset import Dataset, r2_scores


def is_described(name: str) -> bool:
    """Returns whether a name is of a network's description, such as `joint_position FL_hip`."""
    return name[0].islower()


def observation_groups(names: tuple[str, ...]) -> dict[str, NDArray[np.int64]]:
    """Groups observations that differ only by leg; returns columns by merged name, in order."""
    merged = [
        re.sub("[FR][LR]_", "", name) if is_described(name) else entry_of(name).merged_name
        for name in names
    ]
    return {
        group: np.flatnonzero([name == group for name in merged]) for group in dict.fromkeys(merged)
    }


def merge_importances(importances: Array, names: tuple[str, ...]) -> Array:
    """Sums importances (..., n) over the observations of each group (..., n_groups)."""
    groups = observation_groups(names)
    return np.stack(
        [importances[..., columns].sum(axis=-1) for columns in groups.values()], axis=-1
    )


METHOD_TITLES = {
    "permutation": "permutation importance",
    "impurity": "impurity importance",
    "terms": "mean size of terms",
    "derivatives": "mean slope × spread",
}


def permutation_importance(
    policy: Policy, samples: Dataset, generator: np.random.Generator, repeats: int = 10
) -> Array:
    """Measures how much R² each joint loses when one observation is shuffled (repeats, 12, n)."""
    # The RM state's entries are shuffled together, so that each sample has exactly one state.
    baseline, inputs = r2_scores(policy, samples), [*policy.inputs.values()]
    observations, names = samples.observations, policy.observation_names
    state = set() if policy.remembers else set(indices_of("machine state", names))
    blocks = [[entry] for entry in range(len(inputs)) if entry not in state]
    blocks += [sorted(state)] if state else []

    # Shuffle a block, score the student, and divide the loss equally among the block's entries.
    losses = np.zeros((repeats, len(baseline), len(inputs)))
    for repeat in range(repeats):
        for block in blocks:
            columns = [column for entry in block for column in inputs[entry]]
            shuffled = observations.copy()
            shuffled[:, columns] = generator.permutation(observations[:, columns])
            scores = r2_scores(policy, Dataset(shuffled, samples.actions, samples.episodes))
            losses[repeat, :, block] = (baseline - scores) / len(block)
    return losses


N_TOP = 3

PAPER_TOP: dict[str, dict[str, dict[str, list[list[str]]]]] = read_yaml(
    Path(__file__).with_name("paper_table_1.yaml")
)
"""The paper's Table I by method, gait and joint type: first, second and third observations."""


def top_observations(importances: Array, names: tuple[str, ...]) -> dict[str, list[list[str]]]:
    """Lists the first, second and third observations of each joint type, legs merged."""
    # A rank lists the names that the four joints of a type have there, the most frequent first.
    groups = tuple(observation_groups(names))
    order = np.argsort(-merge_importances(importances, names), axis=1, kind="stable")
    tops = {}
    for kind_index, kind in enumerate(quadruped.LEG_JOINTS):
        joints = range(kind_index, quadruped.N_JOINTS, len(quadruped.LEG_JOINTS))
        ranks = [Counter(groups[order[joint, rank]] for joint in joints) for rank in range(N_TOP)]
        tops[kind] = [[name for name, _ in rank.most_common()] for rank in ranks]
    return tops


def top_table(importances: Array, names: tuple[str, ...], gait: str, method: str) -> pd.DataFrame:
    """Lists the three most important observations beside the paper's, if the gait is in it.

    An asterisk marks a name that the paper lists at the same rank.
    """
    paper = PAPER_TOP[method].get(gait, {})
    rows = []
    for kind, ranks in top_observations(importances, names).items():
        row: dict[str, str | float] = {"gait": gait, "joint type": kind}
        paper_ranks = paper.get(kind, [[]] * N_TOP)
        for title, rank, listed in zip(("1st", "2nd", "3rd"), ranks, paper_ranks, strict=True):
            row[title] = ", ".join(name + ("*" if name in listed else "") for name in rank)
            if paper:
                row[f"{title} (paper)"] = ", ".join(sorted(listed)) or np.nan
        rows.append(row)
    return pd.DataFrame(rows)
