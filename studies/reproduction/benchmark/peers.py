"""Time of one action where C does not act: in Python, and by ONNX Runtime."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.gait import Gait, load_gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.studies.common.console import say
from glassgait.studies.deployment.export.agreement import recorded_observations
from glassgait.studies.deployment.export.files import Deployment
from glassgait.studies.reproduction.benchmark.controllers import shipped_policies
from glassgait.studies.reproduction.benchmark.timing import call_times, fastest

COUNT = 3000
"""Calls that are timed."""

N_ROBOTS, N_STEPS = 4, 250
"""Robots that the expert moves, and control steps: what they observe is acted on."""


def observed(gait: Gait, expert: NeuralPolicy) -> Array:
    """Records observations (m, n) of robots that the expert moves."""
    return recorded_observations(gait, alone(expert), N_ROBOTS, N_STEPS, 0)


def peer_times(gait_name: str, count: int = COUNT) -> pd.DataFrame:
    """Times the shipped policies of a gait, one observation at a time.

    Args:
        gait_name: Name of a gait that ships.
        count: Calls that are timed, in each repetition.

    Returns:
        A row a policy: median and 99.9th percentile (µs) of the policy in Python; of estimator and
        policy in Python, and, if it is installed, by ONNX Runtime; the machine's load.
    """
    gait, expert = load_gait(gait_name), load_expert(gait_name)
    observations = observed(gait, expert)
    own = observations[:, :-N_ESTIMATED]
    rows = []
    for kind, policy in shipped_policies(expert).items():
        calls: dict[str, tuple[Callable[[Array], Any], Array]] = {
            "policy, Python": (policy, observations),
            "both, Python": (_both(policy, expert), own),
        }
        if graph := _graph(Deployment(gait, alone(policy, expert), "timed", kind)):
            calls["both, ONNX"] = (graph, own)
        row: dict[str, object] = {"policy": kind}
        times, load = fastest(lambda: [call_times(*one, count) for one in calls.values()])  # noqa: B023
        for title, one in zip(calls, times, strict=True):
            row |= {f"{title} (µs)": one.median, f"{title}, 99.9 % (µs)": one.late}
        rows.append(row | {"load": load})
    return pd.DataFrame(rows)


def _both(policy: Policy, expert: NeuralPolicy) -> Callable[[Array], Array]:
    return lambda own: policy(np.concatenate([own, expert.estimator(own)]))


def _graph(deployment: Deployment) -> Callable[[Array], Any] | None:
    try:
        # Imported here: ONNX and its runtime are an extra.
        from glassgait.models.export.graphs.runtime import LoadedGraph  # noqa: PLC0415
        from glassgait.studies.deployment.export.onnx_file import OnnxFile  # noqa: PLC0415
    except ImportError:
        say("ONNX Runtime is not timed: run pip install 'glassgait[onnx]'")
        return None
    return LoadedGraph(OnnxFile(deployment, "double").model)
