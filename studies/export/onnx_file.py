"""A network as an ONNX file, compared with Python by ONNX Runtime."""

import numpy as np
import pandas as pd

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.export.c_language import Real
from glassgait.models.export.onnx_network import LoadedGraph, write_graph
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.studies.export.agreement import SAME, SEQUENCE_STEPS, recorded_observations


def graph_bytes(
    gait: Gait, controller: AlternatingController, policy_name: str, version: str, real: Real
) -> bytes:
    """Returns a network as the bytes of an ONNX file.

    Raises:
        InputError: if the policy is no network, or does not fit the gait.
    """
    model = write_graph(gait, controller, policy_name=policy_name, version=version, real=real)
    return model.SerializeToString(deterministic=True)


def compare_graph(
    graph: LoadedGraph, gait: Gait, controller: AlternatingController, n_rows: int, seed: int
) -> pd.DataFrame:
    """Compares a graph with Python on observations of robots that the controller moves.

    Returns:
        One row: the number of observations, the greatest difference of a joint target (rad) and of
        an estimated velocity (0.5 m/s) or foot height (m).

    Raises:
        InputError: if they differ by more than `SAME`.
    """
    n_robots = max(1, round(n_rows / SEQUENCE_STEPS))
    n_steps = -(-n_rows // n_robots)
    observations = recorded_observations(gait, controller, n_robots, n_steps, seed)[:n_rows]
    # The graph reads inputs of its precision, so Python gets the same.
    observed, body = np.split(observations.astype(graph.dtype).astype(float), [-N_ESTIMATED], 1)
    if not graph.reads_estimate:
        assert callable(controller.estimator) and not isinstance(controller.estimator, Odometry)
        body = controller.estimator(observed)
    acted = graph(observed, body)
    action = controller.policy(np.concatenate([observed, body], axis=1))
    scale = controller.robot.action_scale
    target, estimate = scale * _apart(acted.action, action), _apart(acted.estimate, body)
    if not max(target, estimate) <= SAME:
        raise InputError(
            f"the ONNX graph differs from Python by {max(target, estimate):.2g}, more than "
            f"{SAME:g}; export it with --precision double or --format c"
        )
    return pd.DataFrame([{"observations": len(observed), "target": target, "estimate": estimate}])


def _apart(graph: Array, python: Array) -> float:
    return float(np.abs(graph - python).max())
