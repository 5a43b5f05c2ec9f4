"""Gradient-boosted trees, evaluated for all joints at once."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.policy import ArraySpec, Indices, Policy, Reals, rounded
from glassgait.models.robots.robot import Robot

if TYPE_CHECKING:
    from sklearn.ensemble import GradientBoostingRegressor, HistGradientBoostingRegressor

    Model = GradientBoostingRegressor | HistGradientBoostingRegressor

_LOWER = "thresholds_lower_neighbours"
"""Array in a file from which the thresholds can be computed, stored instead of them."""


class BoostedTreesPolicy(Policy):
    """Each action is a constant plus one leaf value of each tree (paper, Eq. GBM).

    Every tree is stored as a complete binary tree, its nodes in breadth-first order. Below a leaf
    that ends a branch early, all nodes go left.
    """

    kind = "boosted_trees"
    array_specs: ClassVar[Mapping[str, ArraySpec]] = {
        "features": Indices("joints trees nodes", of="observations"),
        # Nodes below an early leaf have an infinite threshold, and so go left.
        "thresholds": Reals("joints trees nodes", most=np.inf),
        "leaves": Reals("joints trees nodes+1"),
        "intercepts": Reals("joints"),
        "importances": Reals("joints observations", least=0.0),
    }
    features: NDArray[np.integer]
    """Observation that each inner node compares (12, n_trees, 2**depth - 1)."""
    thresholds: Array
    """A node goes left if its observation is at most this; same shape as `features`."""
    leaves: Array  # contribution of each leaf, learning rate included (12, n_trees, 2**depth)
    intercepts: Array
    importances: Array  # share of each observation in the gain of the fit (12, n)

    def __init__(self, gait: str, observation_names: Sequence[str], **options: Any) -> None:
        # Arrays are passed by name only, since several have the same shape.
        super().__init__(gait, observation_names, **options)
        n_joints, n_trees, n_inner = self.features.shape
        self.depth = (n_inner + 1).bit_length() - 1
        if n_inner + 1 != 2**self.depth:
            problem = f"{n_inner} inner nodes are no complete tree"
            raise InputError(f"{self.kind} policy: {problem}; make it again")
        self._trees = np.arange(n_joints * n_trees)
        # Store the nodes by level, all trees side by side, so that the first levels stay in the
        # cache. Node i of a level leads to node 2 i or 2 i + 1 of the next level.
        levels = [slice(2**level - 1, 2 ** (level + 1) - 1) for level in range(self.depth)]
        small = np.min_scalar_type(len(self.observation_names))
        self._features = [self.features[..., nodes].ravel().astype(small) for nodes in levels]
        self._thresholds = [self.thresholds[..., nodes].ravel() for nodes in levels]
        self._leaves = self.leaves.ravel()

    def act(self, observation: Array) -> Array:
        rows = observation.reshape(-1, observation.shape[-1])
        first_entry = rows.shape[1] * np.arange(len(rows))[:, None]
        node = np.tile(self._trees, (len(rows), 1))
        # `take` and sums in place take half as long as general indexing.
        for features, thresholds in zip(self._features, self._thresholds, strict=True):
            entry = features.take(node)
            if len(rows) > 1:
                entry = entry + first_entry
            right = rows.take(entry) > thresholds.take(node)
            node *= 2
            node += right
        contributions = self._leaves.take(node).reshape(len(rows), *self.leaves.shape[:2])
        action = contributions.sum(axis=-1) + self.intercepts
        return action.reshape(*observation.shape[:-1], -1)

    def compact(self) -> Self:
        # Exact trees of scikit-learn keep their thresholds, so that no branch changes.
        exact = lower_neighbours(self.thresholds) is not None
        return self.with_arrays(
            thresholds=self.thresholds if exact else rounded(self.thresholds, np.float32),
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
        arrays = dict(arrays)
        if _LOWER in arrays and "thresholds" not in arrays:
            arrays["thresholds"] = single_precision_cuts(arrays.pop(_LOWER))
        return super().from_arrays(arrays, values, **names)

    def importance(self, observations: Array) -> tuple[str, Array]:
        return "impurity", self.importances

    def tree_values(self, observations: Array, joint: int) -> Array:
        """Returns the contribution of each tree to a joint's action (m, n_trees)."""
        features, thresholds = self.features[joint], self.thresholds[joint]
        row, tree = np.arange(len(observations))[:, None], np.arange(len(features))
        node = np.zeros((len(observations), len(tree)), dtype=np.intp)
        for _ in range(self.depth):
            entry = features[tree, node]
            node = 2 * node + 1 + (observations[row, entry] > thresholds[tree, node])
        return self.leaves[joint, tree, node - (2**self.depth - 1)]

    @classmethod
    def compile(
        cls,
        gait: str,
        observation_names: tuple[str, ...],
        models: "Sequence[Model]",
        robot: Robot | None = None,
    ) -> Self:
        # The fitted trees, and the depth of the deepest.
        fitted = [_fitted(model, len(observation_names)) for model in models]
        joints, constants, importances = zip(*fitted, strict=True)
        n_trees = max(len(trees) for trees in joints)
        depth = max(1, *(tree.depth() for trees in joints for tree in trees))

        # Complete trees; an infinite threshold marks the nodes that no fitted node fills.
        features = np.zeros((len(models), n_trees, 2**depth - 1), dtype=np.int32)
        thresholds = np.full(features.shape, np.inf)
        leaves = np.zeros((len(models), n_trees, 2**depth))
        for joint, trees in enumerate(joints):
            for i, tree in enumerate(trees):
                tree.fill(features[joint, i], thresholds[joint, i], leaves[joint, i])
        return cls(
            gait,
            observation_names,
            robot=robot,
            features=features,
            thresholds=thresholds,
            leaves=leaves,
            intercepts=np.array(constants),
            importances=np.array(importances),
        )


# ---- Single-precision thresholds -------------------------------------------------------------


def single_precision_cuts(thresholds: NDArray[np.floating]) -> Array:
    """Returns cuts c such that `x <= c` if and only if `float32(x) <= threshold`."""
    # Exact trees of scikit-learn round an observation before they compare it.
    below = _single_precision_below(thresholds)
    above = np.nextafter(below, np.float32(np.inf))
    middle = 0.5 * (below.astype(float) + above.astype(float))
    # A number halfway is rounded to the neighbour whose last bit is 0.
    goes_down = middle.astype(np.float32) == below
    return np.where(goes_down, middle, np.nextafter(middle, -np.inf))


def lower_neighbours(cuts: Array) -> NDArray[np.float32] | None:
    """Returns the thresholds that `single_precision_cuts` maps to these cuts, if they exist."""
    below = _single_precision_below(cuts)
    return below if np.array_equal(single_precision_cuts(below), cuts) else None


def _single_precision_below(values: NDArray[Any]) -> NDArray[np.float32]:
    """Returns the greatest single-precision numbers that do not exceed the values."""
    with np.errstate(over="ignore"):
        near = values.astype(np.float32)
    return np.where(near > values, np.nextafter(near, np.float32(-np.inf)), near)


# ---- scikit-learn models ---------------------------------------------------------------------


class _Tree(NamedTuple):
    """A fitted tree; the root is the first node, and `left` is negative at a leaf."""

    features: NDArray[Any]
    thresholds: Array
    left: NDArray[Any]
    right: NDArray[Any]
    values: Array

    def depth(self, node: int = 0) -> int:
        if self.left[node] < 0:
            return 0
        return 1 + max(self.depth(self.left[node]), self.depth(self.right[node]))

    def fill(self, features: NDArray[Any], thresholds: Array, leaves: Array) -> None:
        nodes = [0]
        for slot in range(len(features)):
            node = nodes[slot]
            if node < 0 or self.left[node] < 0:
                # Below a leaf all rows go left, and none reaches the right side.
                nodes += [node, -1]
                continue
            features[slot], thresholds[slot] = self.features[node], self.thresholds[node]
            nodes += [self.left[node], self.right[node]]
        leaves[:] = [0.0 if node < 0 else self.values[node] for node in nodes[len(features) :]]


def _fitted(model: Any, n_observations: int) -> tuple[list[_Tree], float, Array]:
    """Returns the trees, the constant and the impurity importances (n,) of a model."""
    if hasattr(model, "_predictors"):
        return _fitted_by_histograms(model, n_observations)
    trees = []
    for tree in (estimator.tree_ for estimator in model.estimators_[:, 0]):
        cuts, values = single_precision_cuts(tree.threshold), tree.value[:, 0, 0]
        children = tree.children_left, tree.children_right
        trees.append(_Tree(tree.feature, cuts, *children, model.learning_rate * values))
    # scikit-learn starts from the mean of the samples, stored in a dummy regressor.
    return trees, float(np.ravel(model.init_.constant_)[0]), model.feature_importances_


def _fitted_by_histograms(model: Any, n_observations: int) -> tuple[list[_Tree], float, Array]:
    trees = []
    fitted = [predictors[0].nodes for predictors in model._predictors]
    for nodes in fitted:
        left = np.where(nodes["is_leaf"], -1, nodes["left"].astype(int))
        columns = nodes["feature_idx"], nodes["num_threshold"], left, nodes["right"].astype(int)
        trees.append(_Tree(*columns, nodes["value"]))

    # scikit-learn does not compute the importances of these trees.
    nodes = np.concatenate(fitted)
    inner = nodes[nodes["is_leaf"] == 0]
    gains = np.bincount(inner["feature_idx"], inner["gain"], minlength=n_observations)
    shares = gains / max(gains.sum(), np.finfo(float).tiny)
    return trees, float(np.ravel(model._baseline_prediction)[0]), shares
