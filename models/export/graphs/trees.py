"""The graph of boosted trees: one operator walks down all of them."""

import numpy as np
from numpy.typing import NDArray
from onnx import numpy_helper

from glassgait.models.export.graphs.builder import GraphBuilder
from glassgait.models.policies.boosting import BoostedTreesPolicy

_GOES_LEFT_IF_AT_MOST, _SUM, _AS_IT_IS = 0, 1, 0
"""How the operator numbers kinds of questions, of sums and of what is done with them."""


def add_trees(graph: GraphBuilder, policy: BoostedTreesPolicy, observation: str) -> str:
    """Adds trees, whose leaves are summed up for each joint."""
    n_joints, n_trees, n_inner = policy.features.shape
    thresholds = policy.thresholds.reshape(-1, n_inner)
    kept = _reachable(thresholds)
    # The number of each inner node that is kept, counted through all trees.
    numbers = (np.cumsum(kept) - 1).reshape(kept.shape)
    tree, node = np.nonzero(kept)
    reached = _reached(thresholds)
    left = reached[tree, 2 * node + 1]
    # Where a threshold is infinite, which a root's may be, nothing goes right.
    right = np.where(np.isinf(thresholds[kept]), left, reached[tree, 2 * node + 2])
    branches = {
        side: (
            np.where(
                child < n_inner,
                numbers[tree, np.minimum(child, n_inner - 1)],
                tree * (n_inner + 1) + child - n_inner,
            ),
            child >= n_inner,
        )
        for side, child in {"true": left, "false": right}.items()
    }
    n_leaves = n_inner + 1
    sums = graph.add(
        "TreeEnsemble",
        observation,
        n_targets=n_joints,
        aggregate_function=_SUM,
        post_transform=_AS_IT_IS,
        tree_roots=numbers[:, 0].tolist(),
        nodes_modes=numpy_helper.from_array(
            np.full(len(node), _GOES_LEFT_IF_AT_MOST, dtype=np.uint8)
        ),
        nodes_featureids=policy.features.reshape(-1, n_inner)[kept].tolist(),
        nodes_splits=numpy_helper.from_array(thresholds[kept]),
        leaf_targetids=np.repeat(np.arange(n_joints), n_trees * n_leaves).tolist(),
        leaf_weights=numpy_helper.from_array(policy.leaves.ravel()),
        **{f"nodes_{side}nodeids": ids.tolist() for side, (ids, _) in branches.items()},
        **{f"nodes_{side}leafs": leaf.astype(int).tolist() for side, (_, leaf) in branches.items()},
    )
    return graph.add("Add", sums, graph.constant(policy.intercepts))


def _reachable(thresholds: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tells which inner nodes (trees, nodes) ask something: a root, and what can be reached."""
    asks = np.isfinite(thresholds)
    reachable = np.ones_like(asks)
    for node in range(1, asks.shape[1]):
        parent, goes_right = (node - 1) // 2, node % 2 == 0
        reachable[:, node] = reachable[:, parent] & (asks[:, parent] | (not goes_right))
    kept = reachable & asks
    kept[:, 0] = True
    return kept


def _reached(thresholds: NDArray[np.float64]) -> NDArray[np.intp]:
    """Finds the node (trees, 2 nodes + 1) that asks next, or the leaf, from each node on."""
    n_inner = thresholds.shape[1]
    reached = np.tile(np.arange(2 * n_inner + 1), (len(thresholds), 1))
    for node in reversed(range(n_inner)):
        ends_early = np.isinf(thresholds[:, node])
        reached[ends_early, node] = reached[ends_early, 2 * node + 1]
    return reached
