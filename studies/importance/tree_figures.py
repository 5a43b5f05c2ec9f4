"""Figures of boosted trees: a weak learner, and how an action depends on single observations."""

import numpy as np
from matplotlib.figure import Figure
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.inspection import PartialDependenceDisplay

from glassgait.models.arrays import Array
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.studies.common.figures import COLUMN_WIDTH, label_with_unit, styled, subplots

_BOX = {"boxstyle": "round,pad=0.25", "linewidth": 0.6, "edgecolor": "0.4"}


@styled
def tree_figure(
    policy: BoostedTreesPolicy,
    joint: int,
    observations: Array,
    tree: int = 0,
    depth: int = 3,
) -> Figure:
    """Draws the first questions of one of a joint's trees (paper, Figure 6).

    Each box says how many samples come there and what the tree adds to their actions, on average.

    Args:
        policy: The boosted trees.
        joint: Index of the joint.
        observations: Samples (m, n).
        tree: Index of the tree.
        depth: Questions to draw on a branch, at most.
    """
    depth = min(depth, policy.depth)
    added = policy.tree_values(observations, joint)[:, tree]
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 0.4 + 0.65 * (depth + 1)))
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(-depth - 0.4, 0.4))
    axes.set_title(f"{_title(joint)}: tree {tree + 1} of {policy.features.shape[1]}")
    members = {0: np.ones(len(observations), dtype=bool)}
    for node in range(2 ** (depth + 1) - 1):
        if node not in members:
            continue
        mine = members[node]
        mean = float(added[mine].mean()) if mine.any() else 0.0
        label = f"{mine.sum():,} samples\nadds {mean:+.4f}"
        face = "#fde3d3" if mean > 0 else "#d6e8f5"
        if _level(node) < depth and np.isfinite(policy.thresholds[joint, tree, node]):
            feature = int(policy.features[joint, tree, node])
            threshold = float(policy.thresholds[joint, tree, node])
            label = f"{policy.observation_names[feature]}\n≤ {threshold:.3g}?\n{label}"
            face = "white"
            left = observations[:, feature] <= threshold
            members[2 * node + 1], members[2 * node + 2] = mine & left, mine & ~left
        at = _place(node)
        axes.text(
            *at, label, ha="center", va="center", fontsize=5, bbox={**_BOX, "facecolor": face}
        )
        if node:
            above = _place((node - 1) // 2)
            axes.plot(*zip(above, at, strict=True), color="0.4", linewidth=0.7, zorder=0)
            answer = "yes" if node % 2 else "no"
            middle = np.mean([above, at], axis=0)
            halo = {"facecolor": "white", "linewidth": 0, "pad": 0.5}
            axes.text(*middle, answer, fontsize=5, color="0.3", ha="center", bbox=halo)
    return figure


@styled
def dependence_figure(
    policy: Policy,
    joint: int,
    observations: Array,
    columns: tuple[int, ...],
    generator: np.random.Generator,
    n_curves: int = 50,
) -> Figure:
    """Draws how an action depends on single observations, on average and for single samples
    (paper, Figure 7).

    Args:
        policy: The student.
        joint: Index of the joint.
        observations: Samples (m, n).
        columns: Observations to vary.
        generator: Source of randomness, for the samples whose curves are drawn.
        n_curves: Number of those.
    """
    figure, panels = subplots(1, len(columns), figsize=(2 * COLUMN_WIDTH, 2.2), squeeze=False)
    PartialDependenceDisplay.from_estimator(
        _JointRegressor(policy, joint).fit(observations),
        observations,
        columns,
        feature_names=list(policy.observation_names),
        kind="both",
        subsample=min(n_curves, len(observations)),
        random_state=int(generator.integers(2**31)),
        grid_resolution=40,
        ax=list(panels[0]),
        ice_lines_kw={"color": "0.7", "alpha": 0.5, "linewidth": 0.5},
        pd_line_kw={"color": "#D55E00", "linewidth": 1.8, "linestyle": "-"},
    )
    for panel, column in zip(panels[0], columns, strict=True):
        panel.set(xlabel=label_with_unit(policy.robot, policy.observation_names[column]), ylabel="")
        panel.get_legend().remove()
    panels[0][0].set_ylabel(f"action of {_title(joint)}")
    lines = panels[0][0].get_lines()
    lines[0].set_label("one sample")
    lines[-1].set_label("mean")
    panels[0][0].legend(handles=[lines[0], lines[-1]])
    return figure


class _JointRegressor(RegressorMixin, BaseEstimator):
    """One joint of a policy, as scikit-learn's inspection wants to see it."""

    def __init__(self, policy: Policy, joint: int) -> None:
        self.policy = policy
        self.joint = joint

    def fit(self, X: Array, y: None = None) -> "_JointRegressor":
        """Notes the number of observations; the policy is fitted already."""
        self.n_features_in_ = X.shape[1]
        return self

    def predict(self, X: Array) -> Array:
        """Returns the joint's actions (m,)."""
        return self.policy(np.asarray(X))[:, self.joint]


def _level(node: int) -> int:
    return (node + 1).bit_length() - 1


def _place(node: int) -> tuple[float, float]:
    """Where a node of a complete binary tree, numbered breadth-first, stands."""
    level = _level(node)
    return (node + 1.5 - 2**level) / 2**level, -float(level)


def _title(joint: int) -> str:
    return quadruped.JOINTS[joint].replace("_", " ")
