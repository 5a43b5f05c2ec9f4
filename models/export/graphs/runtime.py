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
        estimate: Estimated velocity of the trunk and heights of the feet (..., 7), by itself or as
            it was given.
    """

    action: Array
    estimate: Array


class LoadedGraph:
    """Calls a policy's graph, on one thread.

    Attributes:
        dtype: Type of what it reads.
        reads_estimate: Whether it reads the estimate, which odometry makes.
        metadata: What its file says of it.
    """

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
        read = self._session.get_inputs()
        self.dtype = np.float32 if read[0].type == "tensor(float)" else np.float64
        self.reads_estimate = len(read) > 1
        self.metadata = self._session.get_modelmeta().custom_metadata_map

    def __call__(self, own: Array, estimate: Array | None = None) -> Acted:
        """Maps proprioception (..., 40 + n_states) to actions.

        Args:
            own: Proprioception.
            estimate: The estimate (..., 7), of graphs that read one; others have an estimator.
        """
        read = {OBSERVATION: own}
        if self.reads_estimate:
            assert estimate is not None
            read[ESTIMATE] = estimate
        asked = [ACTIONS] if self.reads_estimate else [ACTIONS, ESTIMATE]
        rows = {
            name: one.reshape(-1, one.shape[-1]).astype(self.dtype) for name, one in read.items()
        }
        given = self._session.run(asked, rows)
        action, *estimated = (
            np.asarray(one, dtype=float).reshape(*own.shape[:-1], -1) for one in given
        )
        return Acted(action, estimated[0] if estimated else read[ESTIMATE])
