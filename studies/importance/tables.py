"""The table of the three most important observations (paper, Table I), beside the paper's."""

from collections import Counter

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.studies.importance.observations import merge_importances, observation_groups

N_TOP = 3

_HIP, _THIGH, _CALF = "Prev Action Hip", "Prev Action Thigh", "Prev Action Calf"
_STATE, _ITERS, _FOOT, _X = "RM State", "RM Iters", "Foot Height", "Command X"

PAPER_TOP = {
    "impurity": {
        "walk": {
            "hip": ({_HIP}, {_STATE}, {_ITERS, "DoF Pos Calf", _CALF, _FOOT}),
            "thigh": ({_THIGH}, {_STATE, _ITERS, "DoF Pos Thigh"}, {_HIP, _X}),
            "calf": ({_HIP, _CALF}, {_ITERS, _HIP, _CALF}, {_HIP, _THIGH}),
        },
        "trot": {
            "hip": ({_HIP}, {_STATE, _ITERS, _HIP, _THIGH}, {_ITERS, _CALF}),
            "thigh": ({_HIP, _THIGH}, {_ITERS, _X, _THIGH, _CALF}, {_ITERS, _STATE, _FOOT}),
            "calf": ({_HIP, _CALF}, {_CALF, _HIP, _STATE}, {_HIP, _THIGH}),
        },
        "pace": {
            "hip": (
                {_HIP, "DoF Vel Hip", _ITERS, _FOOT},
                {"DoF Pos Thigh", "DoF Vel Thigh", _STATE, _ITERS},
                {_HIP, _FOOT, "DoF Vel Calf"},
            ),
            "thigh": ({_HIP, _ITERS, _FOOT}, {_FOOT, _HIP}, {"DoF Vel Hip", "DoF Vel Thigh", _X}),
            "calf": (
                {_HIP, _THIGH},
                {_THIGH, _CALF, _ITERS, _FOOT},
                {_ITERS, "DoF Pos Thigh", "DoF Vel Thigh"},
            ),
        },
        "bound": {
            "hip": ({_HIP}, {_HIP, _THIGH}, {_CALF, "Base Lin Vel Z"}),
            "thigh": ({_THIGH}, {_THIGH, _CALF, _ITERS}, {_FOOT, _X, _HIP, _CALF}),
            "calf": ({_CALF, _HIP}, {_CALF, _HIP}, {_HIP, _THIGH}),
        },
    },
    "permutation": {
        "walk": {
            "hip": ({_HIP}, {_STATE, _FOOT}, {_ITERS, _STATE, _CALF}),
            "thigh": ({_THIGH}, {_STATE, _ITERS, _X}, {_HIP, _X}),
            "calf": ({_HIP, _CALF}, {_CALF, _HIP, _STATE}, {_HIP, _THIGH}),
        },
        "trot": {
            "hip": ({_HIP}, {_STATE, _ITERS, _HIP, _CALF}, {_ITERS, _THIGH, _CALF}),
            "thigh": ({_HIP, _THIGH}, {_ITERS, _X, _THIGH, _CALF}, {_ITERS, _STATE, _FOOT}),
            "calf": ({_HIP, _CALF}, {_CALF, _HIP, _STATE}, {_HIP, _THIGH}),
        },
        "pace": {
            "hip": (
                {_FOOT, _HIP, _ITERS},
                {_HIP, "DoF Pos Hip", _ITERS, "DoF Vel Calf"},
                {_HIP, _THIGH, "DoF Vel Thigh", _STATE},
            ),
            "thigh": ({_HIP, _ITERS, _FOOT}, {_FOOT, _HIP}, {"DoF Vel Hip", "DoF Vel Thigh", _X}),
            "calf": (
                {_HIP, _THIGH},
                {_THIGH, _CALF, _ITERS, _FOOT},
                {_ITERS, "DoF Pos Thigh", "DoF Vel Thigh"},
            ),
        },
        "bound": {
            "hip": ({_HIP}, {_HIP, _THIGH}, {_CALF, _STATE}),
            "thigh": ({_THIGH}, {_X, _HIP}, {_STATE, _ITERS, _THIGH, _CALF}),
            "calf": ({_CALF, _HIP}, {_CALF, _HIP, "Base Lin Vel Z"}, {_HIP, _CALF}),
        },
    },
}
"""The paper's Table I by method, gait and joint type: first, second and third observations."""


def top_observations(importances: Array, names: tuple[str, ...]) -> dict[str, list[list[str]]]:
    """Lists the first, second and third observations of each joint type.

    The rule: importances are added up over observations that differ by leg alone; each of a type's
    four joints names its own first, second and third; a place lists what any of the four named,
    the most frequent first.

    Args:
        importances: Importances (12, n).
        names: Names of the observations.

    Returns:
        For each joint type, three lists of merged names.
    """
    groups = tuple(observation_groups(names))
    order = np.argsort(-merge_importances(importances, names), axis=1, kind="stable")
    tops = {}
    for kind_index, kind in enumerate(quadruped.LEG_JOINTS):
        joints = range(kind_index, quadruped.N_JOINTS, len(quadruped.LEG_JOINTS))
        places = [
            Counter(groups[order[joint, place]] for joint in joints) for place in range(N_TOP)
        ]
        tops[kind] = [[name for name, _ in place.most_common()] for place in places]
    return tops


def top_table(importances: Array, names: tuple[str, ...], gait: str, method: str) -> pd.DataFrame:
    """Sets the three most important observations beside the paper's.

    A name that the paper lists at the same place is marked with an asterisk.

    Args:
        importances: Importances (12, n).
        names: Names of the observations.
        gait: The gait.
        method: `impurity` or `permutation`.
    """
    paper = PAPER_TOP[method].get(gait, {})
    rows = []
    for kind, places in top_observations(importances, names).items():
        row = {"gait": gait, "joint type": kind}
        theirs = paper.get(kind, (set(),) * N_TOP)
        for title, ours, known in zip(("1st", "2nd", "3rd"), places, theirs, strict=True):
            row[title] = ", ".join(name + ("*" if name in known else "") for name in ours)
            row[f"{title} (paper)"] = ", ".join(sorted(known)) or "–"
        rows.append(row)
    return pd.DataFrame(rows)
