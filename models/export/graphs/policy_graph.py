"""A policy and the estimator that it observes by, as one ONNX graph."""

import onnx
from onnx import TensorProto, helper

from glassgait.models.errors import InputError
from glassgait.models.export.controller import exported_estimator
from glassgait.models.export.graphs.builder import (
    OPSET,
    TREE_DOMAIN,
    TREE_OPSET,
    GraphBuilder,
)
from glassgait.models.export.graphs.metadata import metadata
from glassgait.models.export.graphs.policies import add_network
from glassgait.models.export.language import Real
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout
from glassgait.models.task.odometry import Odometry

OBSERVATION, ACTIONS, ESTIMATE = "obs", "actions", "estimate"
"""Names of what the graph reads and gives; the estimate is read where odometry estimates."""

_TYPES = {"double": TensorProto.DOUBLE, "float": TensorProto.FLOAT}


def write_graph(
    gait: Gait,
    controller: AlternatingController,
    *,
    policy_name: str,
    version: str,
    real: Real = "double",
) -> onnx.ModelProto:
    """Writes a policy that acts by what is measured and known, for any number of rows at once.

    The graph reads `obs` (batch, 40 + n_states; 46 + n_states with an IMU), proprioception, and
    gives `actions` (batch, 12) and `estimate` (batch, 7), the estimated velocity of the trunk and
    heights of the feet. Odometry has a memory, and stacks have estimators of their own: with it the
    graph reads the estimate as well, and its metadata say how odometry makes it.

    Args:
        gait: The gait, which the graph's metadata describe.
        controller: One policy alone, with what it estimates by.
        policy_name: What its metadata call the policy.
        version: Version of this project.
        real: Type of what the graph reads and gives. It computes in double precision: cuts of trees
            and tables would part single precision's numbers elsewhere.

    Raises:
        InputError: if a policy is made for another gait or observation, or there is no graph for
            its kind.
    """
    policy, estimator = controller.policy, exported_estimator(controller)
    layout = ObservationLayout(gait.n_states, imu=policy.layout.imu)
    # An expert gives its estimator alone.
    for one in (policy,) if isinstance(estimator, Odometry) else (policy, controller.expert):
        one.check(robot=policy.robot, gait=gait, observation_names=layout.names)
    graph = GraphBuilder()
    own = graph.add("Cast", OBSERVATION, to=TensorProto.DOUBLE)
    reads, gives = [OBSERVATION], [ACTIONS]
    if isinstance(estimator, Odometry):
        estimate = graph.add("Cast", ESTIMATE, to=TensorProto.DOUBLE)
        reads.append(ESTIMATE)
    else:
        estimate = add_network(graph, estimator, own)
        gives.append(ESTIMATE)
    observation = graph.add("Concat", own, estimate, axis=1)
    action = _add_policy(graph, policy, observation)
    for value, name in zip((action, estimate), gives, strict=False):
        graph.add("Cast", value, named=name, to=_TYPES[real])
    sizes = {
        ACTIONS: quadruped.N_JOINTS,
        ESTIMATE: N_ESTIMATED,
        OBSERVATION: layout.n_proprioceptive,
    }
    read, given = (
        [
            helper.make_tensor_value_info(name, _TYPES[real], ["batch", sizes[name]])
            for name in names
        ]
        for names in (reads, gives)
    )
    opsets = [helper.make_opsetid("", OPSET)]
    if graph.has_trees:
        opsets.append(helper.make_opsetid(TREE_DOMAIN, TREE_OPSET))
    model = helper.make_model(
        helper.make_graph(graph.nodes, "policy", read, given, graph.constants),
        opset_imports=opsets,
        ir_version=helper.find_min_ir_version_for(opsets),
        producer_name="glassgait",
        producer_version=version,
    )
    described = metadata(gait, controller, policy_name=policy_name, version=version)
    helper.set_model_props(model, described)
    onnx.checker.check_model(model, full_check=True)
    return model


def _add_policy(graph: GraphBuilder, policy: Policy, observation: str) -> str:
    add = policy.capabilities.function("graph")
    if add is None:
        raise InputError(
            f"there is no graph for policies of kind {policy.kind!r}; export another one"
        )
    return add(graph, policy, observation)
