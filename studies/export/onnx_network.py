"""A network and its estimator as an ONNX file, compared with Python by ONNX Runtime.

ONNX is an optional package: `pip install "glassgait[onnx]"`.
"""

from typing import Any

import numpy as np
import onnx
import onnxruntime
import pandas as pd
from onnx import TensorProto, helper, numpy_helper

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.export.c_language import Real
from glassgait.models.export.c_source import exported_estimator
from glassgait.models.policies.controller import Controller
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.studies.export.agreement import TOLERANCE, recorded_steps

OPSET = 17  # version of ONNX's operators; runtimes since 2022 have it

OBSERVATION, ACTIONS, ESTIMATE = "obs", "actions", "estimate"
"""Names of the graph's inputs and outputs; with odometry, the estimate is an input."""

_TYPES = {"double": TensorProto.DOUBLE, "float": TensorProto.FLOAT}


class _Graph:
    """Builds a graph's nodes and constants, and refers to values by name; axis 0 is the batch."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, values: Any, dtype: type = np.float64) -> str:
        name = f"constant_{len(self.constants)}"
        array = np.asarray(values, dtype=dtype, order="C")
        self.constants.append(numpy_helper.from_array(array, name))
        return name

    def add(self, operator: str, *inputs: str, named: str | None = None, **attributes: Any) -> str:
        output = named or f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, inputs, [output], output, **attributes))
        return output

    def network(self, network: Network, value: str) -> str:
        output = self._layers(network, value)
        if network.reflections is None:
            return output
        mirrored_input, mirrored_output = network.reflections
        image = self._layers(network, self._reflected(mirrored_input, value))
        both = self.add("Add", output, self._reflected(mirrored_output, image))
        return self.add("Mul", both, self.constant(0.5))

    def _layers(self, network: Network, value: str) -> str:
        for place, (weight, bias) in enumerate(zip(network.weights, network.biases, strict=True)):
            value = self._elu(value) if place else value
            product = self.add("MatMul", value, self.constant(weight.T))
            value = self.add("Add", product, self.constant(bias))
        return value

    def _elu(self, value: str) -> str:
        """Adds the exponential linear unit; runtimes have no `Elu` for doubles."""
        zero, one = self.constant(0.0), self.constant(1.0)
        below = self.add("Exp", self.add("Min", value, zero))
        return self.add("Add", self.add("Max", value, zero), self.add("Sub", below, one))

    def _reflected(self, reflection: Any, value: str) -> str:
        image = self.add("Gather", value, self.constant(reflection.index, np.int64), axis=1)
        return self.add("Mul", image, self.constant(reflection.sign))


def graph_bytes(gait: Gait, controller: Controller, version: str, real: Real) -> bytes:
    """Returns the bytes of an ONNX file of a network and its estimator.

    The graph maps `obs` (batch, 40 + n_states; 46 + n_states with an IMU) to `actions` (batch, 12)
    and `estimate` (batch, 7), the velocity of the trunk and the heights of the feet. Odometry has a
    memory, so with it the estimate is an input. The graph computes in double precision.
    """
    policy, estimator = controller.policy, exported_estimator(controller)
    if not isinstance(policy, NeuralPolicy):
        raise InputError(
            f"there is no ONNX graph for policies of kind {policy.kind!r}; use --format c"
        )
    layout = ObservationLayout(gait.n_states, imu=policy.layout.imu)
    policy.check(robot=policy.robot, gait=gait, observation_names=layout.names)

    # Add inputs, the estimator and the actor.
    graph = _Graph()
    observation = graph.add("Cast", OBSERVATION, to=TensorProto.DOUBLE)
    if isinstance(estimator, Odometry):
        inputs, outputs = [OBSERVATION, ESTIMATE], [ACTIONS]
        estimate = graph.add("Cast", ESTIMATE, to=TensorProto.DOUBLE)
    else:
        inputs, outputs = [OBSERVATION], [ACTIONS, ESTIMATE]
        estimate = graph.network(estimator, observation)
    action = graph.network(policy.actor, graph.add("Concat", observation, estimate, axis=1))
    for value, name in zip((action, estimate), outputs, strict=False):
        graph.add("Cast", value, named=name, to=_TYPES[real])

    # Make the model.
    width = layout.n_proprioceptive
    sizes = {OBSERVATION: width, ACTIONS: quadruped.N_JOINTS, ESTIMATE: N_ESTIMATED}
    input_types, output_types = (
        [helper.make_tensor_value_info(key, _TYPES[real], ["batch", sizes[key]]) for key in keys]
        for keys in (inputs, outputs)
    )
    opsets = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(
        helper.make_graph(graph.nodes, "policy", input_types, output_types, graph.constants),
        opset_imports=opsets,
        ir_version=helper.find_min_ir_version_for(opsets),
        producer_name="glassgait",
        producer_version=version,
    )
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString(deterministic=True)


def compare_graph(
    model: bytes, gait: Gait, controller: Controller, n_rows: int, seed: int
) -> pd.DataFrame:
    """Compares a graph with Python on observations of robots that the controller moves.

    Returns the greatest difference of a joint target (rad) and of an estimated velocity (0.5 m/s)
    or foot height (m). Raises an InputError if one is greater than `TOLERANCE`.
    """
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    narrow = session.get_inputs()[0].type == "tensor(float)"
    dtype = np.float32 if narrow else np.float64

    # Round the inputs to the graph's precision, for Python as well.
    steps = recorded_steps(gait, controller, n_rows, seed)
    rows = np.concatenate([step.observation for step in steps])
    observed, body = np.split(rows.astype(dtype).astype(float), [-N_ESTIMATED], 1)
    inputs = {OBSERVATION: observed.astype(dtype)}
    if isinstance(controller.estimator, Odometry):
        action, estimate = session.run([ACTIONS], inputs | {ESTIMATE: body.astype(dtype)})[0], body
    else:
        assert controller.estimator is not None
        body = controller.estimator(observed)
        action, estimate = session.run([ACTIONS, ESTIMATE], inputs)
    expected = controller.policy(np.concatenate([observed, body], axis=1))
    target_error = controller.robot.action_scale * _difference(action, expected)
    estimate_error = _difference(estimate, body)
    # NaN is refused as well.
    error = max(target_error, estimate_error)
    if not error <= TOLERANCE:
        raise InputError(
            f"the ONNX graph differs from Python by {error:.2g}; export it with --format c"
        )
    errors = {"target": target_error, "estimate": estimate_error}
    return pd.DataFrame([{"observations": len(rows), **errors}])


def _difference(graph: Any, python: Array) -> float:
    return float(np.abs(graph - python).max())
