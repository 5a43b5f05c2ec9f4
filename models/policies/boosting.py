"""Gradient-boosted trees, compiled to flat arrays and evaluated for all joints at once."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import GradientBoostingRegressor

from models.a1.robot import Array
from models.policies.policy import Policy


class BoostedTreesPolicy(Policy):
    """Each action is a constant plus the leaves that the observation falls into (paper, Eq. GBM).

    Every tree is stored as a complete binary tree, its nodes in breadth-first order; a branch that
    ends early goes left for ever.

    Attributes:
        features: Observation that an inner node asks for (12, n_trees, 2**depth - 1).
        thresholds: The node goes left where the observation is at most this, same shape.
        leaves: Contribution of each leaf, learning rate included (12, n_trees, 2**depth).
        intercepts: Constants (12,).
    """

    kind = "boosted_trees"
    array_names = ("features", "thresholds", "leaves", "intercepts")

    def __init__(
        self,
        gait: str,
        observation_names: tuple[str, ...],
        features: NDArray[np.int32],
        thresholds: Array,
        leaves: Array,
        intercepts: Array,
    ) -> None:
        super().__init__(gait, observation_names)
        self.features = features
        self.thresholds = thresholds
        self.leaves = leaves
        self.intercepts = intercepts
        n_joints, n_trees, n_inner = features.shape
        self._depth = (n_inner + 1).bit_length() - 1
        tree = np.arange(n_joints * n_trees)
        self._first_inner = tree * n_inner
        self._first_leaf = tree * (n_inner + 1)
        self._flat_features = features.ravel()
        self._flat_thresholds = thresholds.ravel()
        self._flat_leaves = leaves.ravel()

    @classmethod
    def compile(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        models: Sequence[GradientBoostingRegressor],
    ) -> Self:
        """Compiles one fitted scikit-learn model a joint."""
        depth = max(tree.tree_.max_depth for model in models for tree in model.estimators_[:, 0])
        depth = max(depth, 1)
        compiled = [
            [_complete(tree.tree_, depth, model.learning_rate) for tree in model.estimators_[:, 0]]
            for model in models
        ]
        return cls(
            gait,
            observation_names,
            features=np.array([[tree.features for tree in joint] for joint in compiled]),
            thresholds=np.array([[tree.thresholds for tree in joint] for joint in compiled]),
            leaves=np.array([[tree.leaves for tree in joint] for joint in compiled]),
            intercepts=np.array([_constant(model.init_) for model in models]),
        )

    def __call__(self, observation: Array) -> Array:
        # scikit-learn compares in single precision; so must we, to take the same branches.
        rows = observation.reshape(-1, observation.shape[-1]).astype(np.float32).astype(float)
        node = np.zeros((len(rows), len(self._first_inner)), dtype=np.intp)
        row = np.arange(len(rows))[:, None]
        for _ in range(self._depth):
            at = self._first_inner + node
            right = rows[row, self._flat_features[at]] > self._flat_thresholds[at]
            node = 2 * node + 1 + right
        leaf = self._first_leaf + node - (2**self._depth - 1)
        contributions = self._flat_leaves[leaf].reshape(len(rows), *self.leaves.shape[:2])
        action = contributions.sum(axis=-1) + self.intercepts
        return action.reshape(*observation.shape[:-1], -1)


class _CompleteTree(NamedTuple):
    features: NDArray[np.int32]
    thresholds: Array
    leaves: Array


def _constant(initial: Any) -> float:
    # scikit-learn starts from the mean of the samples, held by a dummy regressor.
    return float(np.ravel(initial.constant_)[0])


def _complete(tree: Any, depth: int, learning_rate: float) -> _CompleteTree:
    features = np.zeros(2**depth - 1, dtype=np.int32)
    thresholds = np.full(2**depth - 1, np.inf)
    leaves = np.zeros(2**depth)

    def place(node: int, slot: int, level: int) -> None:
        ends = tree.children_left[node] < 0
        if level == depth:
            leaves[slot - (2**depth - 1)] = learning_rate * tree.value[node, 0, 0]
        elif ends:
            place(node, 2 * slot + 1, level + 1)
        else:
            features[slot] = tree.feature[node]
            thresholds[slot] = tree.threshold[node]
            place(tree.children_left[node], 2 * slot + 1, level + 1)
            place(tree.children_right[node], 2 * slot + 2, level + 1)

    place(0, 0, 0)
    return _CompleteTree(features, thresholds, leaves)
