"""A policy and the estimator that it observes by, as one ONNX graph."""

import onnx
from onnx import TensorProto, helper

from glassgait.models.errors import InputError
from glassgait.models.export.graphs.builder import (
    OPSET,
    TREE_DOMAIN,
    TREE_OPSET,
    GraphBuilder,
)
from glassgait.models.export.graphs.metadata import metadata
from glassgait.models.export.graphs.policies import add_network
from glassgait.models.export.language import Real
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import N_ESTIMATED, ObservationLayout

OBSERVATION, ACTIONS, ESTIMATE = "obs", "actions", "estimate"
"""Names of the graph's input and of its outputs."""

_TYPES = {"double": TensorProto.DOUBLE, "float": TensorProto.FLOAT}


def write_graph(
    gait: Gait,
    policy: Policy,
    expert: NeuralPolicy,
    *,
    policy_name: str,
    version: str,
    real: Real = "double",
) -> onnx.ModelProto:
    """Writes a policy that acts by what is measured and known, for any number of rows at once.

    The graph reads `obs` (batch, 40 + n_states), proprioception; it gives `actions` (batch, 12) and
    `estimate` (batch, 7), the estimated velocity of the trunk and heights of the feet.

    Args:
        gait: The gait, which the graph's metadata describe.
        policy: The policy that acts: a student, or the expert.
        expert: Its estimator observes what no sensor measures.
        policy_name: What its metadata call the policy.
        version: Version of this project.
        real: Type of what the graph reads and gives. It computes in double precision: cuts of trees
            and tables would part single precision's numbers elsewhere.

    Raises:
        InputError: if a policy is made for another gait or observation, or there is no graph for
            its kind.
    """
    layout = ObservationLayout(gait.n_states)
    for one in (policy, expert):
        one.check(robot=policy.robot, gait=gait.name, observation_names=layout.names)
    graph = GraphBuilder()
    own = graph.add("Cast", OBSERVATION, to=TensorProto.DOUBLE)
    estimate = add_network(graph, expert.learned_estimator, own)
    observation = graph.add("Concat", own, estimate, axis=1)
    action = _add_policy(graph, policy, observation)
    for value, name in ((action, ACTIONS), (estimate, ESTIMATE)):
        graph.add("Cast", value, named=name, to=_TYPES[real])
    sizes = {
        ACTIONS: quadruped.N_JOINTS,
        ESTIMATE: N_ESTIMATED,
        OBSERVATION: layout.n_proprioceptive,
    }
    read, *given = (
        helper.make_tensor_value_info(name, _TYPES[real], ["batch", sizes[name]])
        for name in (OBSERVATION, ACTIONS, ESTIMATE)
    )
    opsets = [helper.make_opsetid("", OPSET)]
    if graph.has_trees:
        opsets.append(helper.make_opsetid(TREE_DOMAIN, TREE_OPSET))
    model = helper.make_model(
        helper.make_graph(graph.nodes, "policy", [read], given, graph.constants),
        opset_imports=opsets,
        ir_version=helper.find_min_ir_version_for(opsets),
        producer_name="glassgait",
        producer_version=version,
    )
    described = metadata(gait, policy, expert, policy_name=policy_name, version=version)
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
