"""Gradient-boosted trees, evaluated for all joints at once."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.arrays import (
    Indices,
    Reals,
    lower_neighbours,
    rounded,
    single_precision_cuts,
)
from glassgait.models.policies.policy import Policy
from glassgait.models.robots.robot import Robot

_LOWER = "thresholds_lower_neighbours"
"""The array that a file holds instead of thresholds that hold no more."""


class BoostedTreesPolicy(Policy):
    """Each action is a constant plus the leaves that the observation falls into (paper, Eq. GBM).

    Every tree is stored as a complete binary tree, its nodes in breadth-first order; a branch that
    ends early goes left for ever.

    Attributes:
        features: Observation that an inner node asks for (12, n_trees, 2**depth - 1).
        thresholds: The node goes left where the observation is at most this, same shape.
        leaves: Contribution of each leaf, learning rate included (12, n_trees, 2**depth).
        intercepts: Constants (12,).
        importances: Share of the fit's gain at nodes that ask for each observation (12, n), the
            impurity importance.
        depth: Questions on the longest branch.
    """

    kind = "boosted_trees"
    array_specs: ClassVar = {
        "features": Indices("joints trees nodes", of="observations"),
        # A branch that ends early goes left of infinity.
        "thresholds": Reals("joints trees nodes", most=np.inf),
        "leaves": Reals("joints trees nodes+1"),
        "intercepts": Reals("joints"),
        "importances": Reals("joints observations", least=0.0),
    }
    features: NDArray[np.integer]
    thresholds: Array
    leaves: Array
    intercepts: Array
    importances: Array

    def __init__(self, gait: str, observation_names: Sequence[str], **options: Any) -> None:
        # Some arrays are of one shape: all go by name.
        super().__init__(gait, observation_names, **options)
        n_joints, n_trees, n_inner = self.features.shape
        self.depth = (n_inner + 1).bit_length() - 1
        if n_inner + 1 != 2**self.depth:
            raise InputError(
                f"{self.kind} policy: its trees have {n_inner} inner nodes, and a complete tree "
                "2**depth - 1; make it anew"
            )
        self._trees = np.arange(n_joints * n_trees)
        # Level by level, all trees beside one another: where node i of a level goes to is node
        # 2 i or 2 i + 1 of the next, and what the first levels ask for stays in the cache.
        levels = [slice(2**level - 1, 2 ** (level + 1) - 1) for level in range(self.depth)]
        small = np.min_scalar_type(len(self.observation_names))
        self._features = [self.features[..., nodes].ravel().astype(small) for nodes in levels]
        self._thresholds = [self.thresholds[..., nodes].ravel() for nodes in levels]
        self._leaves = self.leaves.ravel()

    @classmethod
    def compile(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        models: Sequence[GradientBoostingRegressor | HistGradientBoostingRegressor],
        robot: Robot | None = None,
    ) -> Self:
        """Compiles one fitted scikit-learn model a joint."""
        compiled = compiled_trees(models, len(observation_names))
        return cls(gait, observation_names, robot=robot, **compiled)

    def __call__(self, observation: Array) -> Array:
        rows = observation.reshape(-1, observation.shape[-1])
        first_entry = rows.shape[1] * np.arange(len(rows))[:, None]
        at = np.tile(self._trees, (len(rows), 1))
        # `take` and sums in place take half as long as general indexing.
        for features, thresholds in zip(self._features, self._thresholds, strict=True):
            asked = features.take(at)
            if len(rows) > 1:
                asked = asked + first_entry
            right = rows.take(asked) > thresholds.take(at)
            at *= 2
            at += right
        contributions = self._leaves.take(at).reshape(len(rows), *self.leaves.shape[:2])
        action = contributions.sum(axis=-1) + self.intercepts
        return action.reshape(*observation.shape[:-1], -1)

    def compact(self) -> Self:
        """Returns the policy with leaves, and thresholds, that its file holds in single precision.

        The file is half as large. The thresholds of scikit-learn's exact trees stay as they are, so
        that every branch is the same and an action differs by rounding alone. Those of trees by
        histograms are rounded.
        """
        as_they_are = lower_neighbours(self.thresholds) is not None
        return self.with_arrays(
            thresholds=self.thresholds if as_they_are else rounded(self.thresholds, np.float32),
            leaves=rounded(self.leaves, np.float32),
            importances=rounded(self.importances, np.float32),
        )

    def to_arrays(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, values = super().to_arrays()
        lower = lower_neighbours(self.thresholds)
        if lower is not None:
            del arrays["thresholds"]
            arrays[_LOWER] = lower
        return arrays, values

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any], **names: Any
    ) -> Self:
        own = dict(arrays)
        if _LOWER in own and "thresholds" not in own:
            own["thresholds"] = single_precision_cuts(own.pop(_LOWER))
        return super().from_arrays(own, values, **names)

    def importance(self, observations: Array) -> tuple[str, Array]:
        return "impurity", self.importances

    def tree_values(self, observations: Array, joint: int) -> Array:
        """Returns what each tree adds to a joint's action (m, n_trees), of observations (m, n)."""
        features, thresholds = self.features[joint], self.thresholds[joint]
        row, tree = np.arange(len(observations))[:, None], np.arange(len(features))
        node = np.zeros((len(observations), len(tree)), dtype=np.intp)
        for _ in range(self.depth):
            asked = features[tree, node]
            node = 2 * node + 1 + (observations[row, asked] > thresholds[tree, node])
        return self.leaves[joint, tree, node - (2**self.depth - 1)]


def compiled_trees(
    models: Sequence[GradientBoostingRegressor | HistGradientBoostingRegressor], n_observations: int
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
