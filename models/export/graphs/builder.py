"""Building an ONNX graph, one operator after the other."""

from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

OPSET = 17
"""Version of ONNX's operators: old enough for runtimes since 2022, and they have not changed."""

TREE_OPSET = 5
"""Version of ai.onnx.ml whose trees hold thresholds in double precision."""

TREE_DOMAIN = "ai.onnx.ml"


class GraphBuilder:
    """Nodes and constants of a graph; a value is known by its name.

    Everything is computed in double precision, on rows: the first axis is the batch.
    """

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, values: Any, dtype: type = np.float64) -> str:
        """Adds a constant array and returns its name."""
        name = f"constant_{len(self.constants)}"
        array: NDArray[Any] = np.asarray(values, dtype=dtype, order="C")
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def indices(self, values: Any) -> str:
        """Adds a constant array of whole numbers, such as a shape, and returns its name."""
        return self.constant(values, np.int64)

    def add(self, operator: str, *inputs: str, named: str | None = None, **attributes: Any) -> str:
        """Adds an operator and returns the name of what it gives."""
        output = named or f"{operator.lower()}_{len(self.nodes)}"
        domain = TREE_DOMAIN if operator == "TreeEnsemble" else ""
        node = helper.make_node(operator, inputs, [output], output, domain=domain, **attributes)
        self.nodes.append(node)
        return output

    def whole(self, value: str) -> str:
        """Casts to whole numbers."""
        return self.add("Cast", value, to=onnx.TensorProto.INT64)

    def tensor(self, array: NDArray[Any]) -> onnx.TensorProto:
        """Returns an array as an operator's attribute."""
        return numpy_helper.from_array(array)

    def columns(self, value: str, start: int, stop: int) -> str:
        """Takes some columns of rows."""
        return self.add(
            "Slice", value, self.indices([start]), self.indices([stop]), self.indices([1])
        )

    def taken(self, value: str, columns: Any) -> str:
        """Takes the columns of rows in a given order; some twice, some not at all."""
        return self.add("Gather", value, self.indices(columns), axis=1)

    @property
    def has_trees(self) -> bool:
        """Whether an operator is not of ONNX's own domain, but of its trees'."""
        return any(node.domain == TREE_DOMAIN for node in self.nodes)
