"""The graph of additive models: look-up tables of one observation and of two."""

import numpy as np
from onnx import TensorProto

from glassgait.models.arrays import Array
from glassgait.models.export.graphs.builder import GraphBuilder
from glassgait.models.policies.additive import AdditivePolicy


def add_additive(graph: GraphBuilder, policy: AdditivePolicy, observation: str) -> str:
    """Adds sums of functions of one observation, and of two."""
    n_joints, n, bins = policy.tables.shape
    # All tables lie below one another; a row holds what a bin adds to all joints.
    effects = np.moveaxis(policy.tables, 0, -1).reshape(n * bins, n_joints)
    row = graph.add("Add", _bins(graph, policy.cuts, observation), _starts(graph, n, bins))
    added = graph.add("Gather", graph.constant(effects), row, axis=0)
    sums = graph.add("ReduceSum", added, graph.indices([1]), keepdims=0)
    action = graph.add("Add", sums, graph.constant(policy.intercepts))
    if len(policy.pairs):
        action = graph.add("Add", action, _of_pairs(graph, policy, observation))
    return action


def _of_pairs(graph: GraphBuilder, policy: AdditivePolicy, observation: str) -> str:
    n_pairs, bins, _ = policy.pair_tables.shape
    coarse = _bins(graph, policy.pair_cuts, observation)
    first, second = (graph.taken(coarse, own) for own in policy.pairs.T)
    inside = graph.add("Add", graph.add("Mul", first, graph.indices(bins)), second)
    place = graph.add("Add", inside, _starts(graph, n_pairs, bins * bins))
    effects = graph.add("Gather", graph.constant(policy.pair_tables.ravel()), place)
    of_joint = np.eye(len(policy.intercepts))[policy.pair_joints]
    return graph.add("MatMul", effects, graph.constant(of_joint))


def _bins(graph: GraphBuilder, cuts: Array, observation: str) -> str:
    """Adds the number of cuts that are at most as great, of each observation."""
    column = graph.add("Unsqueeze", observation, graph.indices([2]))
    passed = graph.add("GreaterOrEqual", column, graph.constant(cuts))
    counted = graph.add("Cast", passed, to=TensorProto.INT64)
    return graph.add("ReduceSum", counted, graph.indices([2]), keepdims=0)


def _starts(graph: GraphBuilder, count: int, size: int) -> str:
    return graph.indices(size * np.arange(count))
