"""scikit-learn's boosted trees, compiled to flat arrays."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

from glassgait.models.arrays import Array
from glassgait.models.policies.precision import single_precision_cuts


def compiled_trees(
    models: Sequence[GradientBoostingRegressor | HistGradientBoostingRegressor],
    n_observations: int,
) -> dict[str, NDArray[Any]]:
    """Compiles one fitted model a joint.

    Returns:
        The arrays of `BoostedTreesPolicy`, by name.
    """
    joints = [
        _histogram_trees(model)
        if isinstance(model, HistGradientBoostingRegressor)
        else _exact_trees(model)
        for model in models
    ]
    n_trees = max(len(trees) for trees in joints)
    depth = max(1, *(tree.depth() for trees in joints for tree in trees))
    compiled = [
        [tree.complete(depth) for tree in trees] + [_nothing(depth)] * (n_trees - len(trees))
        for trees in joints
    ]
    return {
        "features": np.array([[tree.features for tree in joint] for joint in compiled]),
        "thresholds": np.array([[tree.thresholds for tree in joint] for joint in compiled]),
        "leaves": np.array([[tree.leaves for tree in joint] for joint in compiled]),
        "intercepts": np.array([_constant(model) for model in models]),
        "importances": np.array([_importances(model, n_observations) for model in models]),
    }


class _CompleteTree(NamedTuple):
    features: NDArray[np.int32]
    thresholds: Array
    leaves: Array


class _Tree(NamedTuple):
    """A fitted tree, nodes in any order and the root first; a leaf's `left` is negative."""

    features: NDArray[Any]
    thresholds: Array
    left: NDArray[Any]
    right: NDArray[Any]
    values: Array

    def depth(self, node: int = 0) -> int:
        """Counts the questions on the longest branch."""
        if self.left[node] < 0:
            return 0
        return 1 + max(self.depth(self.left[node]), self.depth(self.right[node]))

    def complete(self, depth: int) -> _CompleteTree:
        """Fills the tree up to a depth."""
        done = _nothing(depth)

        def place(node: int, slot: int, level: int) -> None:
            if level == depth:
                done.leaves[slot - (2**depth - 1)] = self.values[node]
            elif self.left[node] < 0:
                place(node, 2 * slot + 1, level + 1)
            else:
                done.features[slot] = self.features[node]
                done.thresholds[slot] = self.thresholds[node]
                place(self.left[node], 2 * slot + 1, level + 1)
                place(self.right[node], 2 * slot + 2, level + 1)

        place(0, 0, 0)
        return done


def _nothing(depth: int) -> _CompleteTree:
    inner = 2**depth - 1
    return _CompleteTree(
        np.zeros(inner, dtype=np.int32), np.full(inner, np.inf), np.zeros(inner + 1)
    )


def _constant(model: Any) -> float:
    if isinstance(model, HistGradientBoostingRegressor):
        return float(np.ravel(model._baseline_prediction)[0])
    # scikit-learn starts from the mean of the samples, held by a dummy regressor.
    return float(np.ravel(model.init_.constant_)[0])


def _importances(model: Any, n_observations: int) -> Array:
    if not isinstance(model, HistGradientBoostingRegressor):
        return model.feature_importances_
    nodes = np.concatenate([predictors[0].nodes for predictors in model._predictors])
    inner = nodes[nodes["is_leaf"] == 0]
    gains = np.bincount(inner["feature_idx"], inner["gain"], minlength=n_observations)
    return gains / max(gains.sum(), np.finfo(float).tiny)


def _exact_trees(model: GradientBoostingRegressor) -> list[_Tree]:
    trees = [estimator.tree_ for estimator in model.estimators_[:, 0]]
    return [
        _Tree(
            tree.feature,
            single_precision_cuts(tree.threshold),
            tree.children_left,
            tree.children_right,
            model.learning_rate * tree.value[:, 0, 0],
        )
        for tree in trees
    ]


def _histogram_trees(model: HistGradientBoostingRegressor) -> list[_Tree]:
    every_nodes = [predictors[0].nodes for predictors in model._predictors]
    return [
        _Tree(
            nodes["feature_idx"],
            nodes["num_threshold"],
            np.where(nodes["is_leaf"], -1, nodes["left"].astype(int)),
            nodes["right"].astype(int),
            nodes["value"],
        )
        for nodes in every_nodes
    ]
