"""A policy's graph, evaluated by ONNX Runtime."""

from typing import NamedTuple

import numpy as np
import onnxruntime

from glassgait.models.arrays import Array
from glassgait.models.export.graphs.policy_graph import ACTIONS, ESTIMATE, OBSERVATION


class Acted(NamedTuple):
    """What a graph gives.

    Attributes:
        action: Actions (..., 12).
        estimate: Estimated velocity of the trunk and heights of the feet (..., 7).
    """

    action: Array
    estimate: Array


class LoadedGraph:
    """Calls a policy's graph, on one thread."""

    def __init__(self, model: bytes) -> None:
        """
        Args:
            model: The graph as its file holds it.
        """
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session = onnxruntime.InferenceSession(
            model, options, providers=["CPUExecutionProvider"]
        )
        (read,) = self._session.get_inputs()
        self.dtype = np.float32 if read.type == "tensor(float)" else np.float64
        self.metadata = self._session.get_modelmeta().custom_metadata_map

    def __call__(self, own: Array) -> Acted:
        """Maps proprioception (..., 40 + n_states) to actions, through the estimator."""
        rows = own.reshape(-1, own.shape[-1]).astype(self.dtype)
        given = self._session.run([ACTIONS, ESTIMATE], {OBSERVATION: rows})
        action, estimate = (np.asarray(one, dtype=float) for one in given)
        shape = own.shape[:-1]
        return Acted(action.reshape(*shape, -1), estimate.reshape(*shape, -1))
