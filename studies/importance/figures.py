"""The paper's figures of students: importance maps, trees, dependences, functions and terms."""

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.inspection import PartialDependenceDisplay

from glassgait.models.arrays import Array
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.policy import Contributions, Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of, entry_of, symbols_of
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots


def _with_unit(policy: Policy, index: int) -> str:
    """Returns an axis label: an observation's symbol, with its unit below."""
    entry = entry_of(policy.observation_names[index])
    return f"{entry.symbol}\n({entry.unit})" if entry.unit else entry.symbol


@styled
def importance_map(importances: Array, names: Sequence[str], title: str) -> Figure:
    """Draws importances (12, n) as a map, each joint's scaled to add up to 1 (paper, Figure 11)."""
    positive = np.maximum(importances, 0.0)
    totals = positive.sum(axis=1, keepdims=True)
    shares = np.divide(positive, totals, out=np.zeros_like(positive), where=totals > 0)

    # The map, a row for each joint.
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 2.9))
    image = axes.imshow(shares, cmap="viridis", aspect="auto", vmin=0.0)
    axes.set_yticks(range(quadruped.N_JOINTS), [*map(_title, range(quadruped.N_JOINTS))])
    axes.set_xticks(range(len(names)), names, rotation=90, fontsize=5)
    axes.set_title(title)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, pad=0.01).set_label("share of a joint's importance")
    return figure


@styled
def tree_figure(policy: BoostedTreesPolicy, joint: int, observations: Array) -> Figure:
    """Draws the first three levels of a joint's first tree (paper, Figure 6).

    Each box shows how many of the samples (m, n) reach the node, and their mean change of target
    (rad).
    """
    depth = min(3, policy.depth)
    added = policy.robot.action_scale * policy.tree_values(observations, joint)[:, 0]
    features, thresholds = policy.features[joint, 0], policy.thresholds[joint, 0]
    units = RobotUnits.of(policy.robot, policy.observation_names)
    entries = entries_of(policy.observation_names)
    figure, axes = subplots(figsize=(2 * COLUMN_WIDTH, 0.4 + 0.65 * (depth + 1)))
    axes.set_axis_off()
    axes.set(xlim=(0, 1), ylim=(-depth - 0.4, 0.4))
    axes.set_title(f"{_title(joint)}: tree 1 of {policy.features.shape[1]}")

    # Visit the nodes from the root, each with the samples that reach it.
    members = {0: np.ones(len(observations), dtype=bool)}
    for node in range(2 ** (depth + 1) - 1):
        if node not in members:
            continue
        reaching = members[node]
        mean = float(added[reaching].mean()) if reaching.any() else 0.0
        label = f"{reaching.sum():,} samples\nadds {mean:+.4f} rad".replace("-", "\N{MINUS SIGN}")
        face = "#fde3d3" if mean > 0 else "#d6e8f5"
        if _level(node) < depth and np.isfinite(thresholds[node]):
            feature, threshold = int(features[node]), float(thresholds[node])
            # Show the threshold in the robot's units.
            quantity = threshold / units.scale[feature] + units.offset[feature]
            entry = entries[feature]
            question = f"{entry.symbol}\n≤ {quantity:.3g} {entry.unit}?".replace(" ?", "?")
            label = f"{question}\n{label}"
            face = "white"
            left = observations[:, feature] <= threshold
            members[2 * node + 1], members[2 * node + 2] = reaching & left, reaching & ~left

        # Draw the box, and the branch from its parent.
        at = _place(node)
        box = {"boxstyle": "round,pad=0.25", "linewidth": 0.6, "edgecolor": "0.4"}
        box["facecolor"] = face
        axes.text(*at, label, ha="center", va="center", fontsize=5, bbox=box)
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
    """Draws how a target depends on each observation, on average and for samples (m, n) that the
    generator selects (paper, Figure 7)."""
    # scikit-learn varies one quantity at a time.
    figure, panels = subplots(1, len(columns), figsize=(2 * COLUMN_WIDTH, 2.2), squeeze=False)
    quantities = RobotUnits.of(policy.robot, policy.observation_names).quantities(observations)
    PartialDependenceDisplay.from_estimator(
        _JointRegressor(policy, joint).fit(quantities),
        quantities,
        columns,
        feature_names=list(symbols_of(policy.observation_names)),
        kind="both",
        subsample=min(n_curves, len(observations)),
        random_state=int(generator.integers(2**31)),
        grid_resolution=40,
        ax=list(panels[0]),
        ice_lines_kw={"color": "0.7", "alpha": 0.5, "linewidth": 0.5},
        pd_line_kw={"color": "#D55E00", "linewidth": 1.8, "linestyle": "-"},
    )

    # Axes in the robot's units, and one legend for all panels.
    for panel, column in zip(panels[0], columns, strict=True):
        panel.set(xlabel=_with_unit(policy, column), ylabel="")
        panel.get_legend().remove()
    panels[0][0].set_ylabel(f"target of {_title(joint)} (rad)")
    lines = panels[0][0].get_lines()
    lines[0].set_label("one sample")
    lines[-1].set_label("mean")
    panels[0][0].legend(handles=[lines[0], lines[-1]])
    return figure


class _JointRegressor(RegressorMixin, BaseEstimator):
    """One joint of a policy as a regressor of scikit-learn, for its partial dependence."""

    def __init__(self, policy: Policy, joint: int) -> None:
        self.policy, self.joint = policy, joint

    def fit(self, X: Array, y: None = None) -> "_JointRegressor":
        # The policy is fitted already; scikit-learn looks for this attribute.
        self.n_features_in_ = X.shape[1]
        return self

    def predict(self, X: Array) -> Array:
        """Returns the joint's targets (m,; rad) at quantities (m, n) in the robot's units."""
        robot = self.policy.robot
        observed = RobotUnits.of(robot, self.policy.observation_names).observed(np.asarray(X))
        return robot.joint_targets(self.policy(observed))[:, self.joint]


def _level(node: int) -> int:
    return (node + 1).bit_length() - 1


def _place(node: int) -> tuple[float, float]:
    """Returns the place of a node of a complete binary tree, numbered breadth-first."""
    level = _level(node)
    return (node + 1.5 - 2**level) / 2**level, -float(level)


def _title(joint: int) -> str:
    return quadruped.JOINTS[joint].replace("_", " ")


POSITIVE, NEGATIVE, NEUTRAL = "#D55E00", "#0072B2", "0.55"


@styled
def term_figure(parts: Contributions, title: str, n_terms: int = 15) -> Figure:
    """Ranks the terms of samples' targets by their mean size (paper, Figure 10)."""
    importances, names = np.abs(parts.values).mean(axis=0), parts.terms
    # The intercept comes first, and is left out.
    order = 1 + np.argsort(-importances[1:], kind="stable")[:n_terms]
    figure, axes = subplots(figsize=(COLUMN_WIDTH, 0.7 + 0.16 * len(order)))
    axes.barh(range(len(order)), importances[order], color="#0072B2")
    axes.set_yticks(range(len(order)), [names[index] for index in order], fontsize=6)
    axes.invert_yaxis()
    axes.set(xlabel="mean |contribution| to the target (rad)", title=title)
    return figure


def _edges(cuts: Array, quantities: Array) -> Array:
    """Returns the edges of an observation's bins, extended to the range of the samples."""
    cuts = cuts[np.isfinite(cuts)]
    ends = np.append(cuts, quantities)
    return np.array([ends.min(), *cuts, ends.max()])


@styled
def shape_figure(
    policy: AdditivePolicy, joint: int, observations: Array, columns: tuple[int, ...], title: str
) -> Figure:
    """Draws functions of one observation with bands of two standard deviations between the bagged
    models, above histograms of the observations (m, n) (paper, Figure 8, top)."""
    units = RobotUnits.of(policy.robot, policy.observation_names)
    cuts, quantities = units.quantities(policy.cuts.T).T, units.quantities(observations)
    scale, size = policy.robot.action_scale, (2 * COLUMN_WIDTH, 2.3)
    figure, panels = subplots(
        2, len(columns), figsize=size, squeeze=False, height_ratios=(4, 1), sharex="col"
    )
    for (above, below), column in zip(panels.T, columns, strict=True):
        # Bins beyond the last cut are padding.
        edges = _edges(cuts[column], quantities[:, column])
        bins = slice(len(edges) - 1)
        scores = scale * policy.tables[joint, column, bins]
        band = 2.0 * scale * policy.deviations[joint, column, bins]
        above.stairs(
            scores + band, edges, baseline=scores - band, fill=True, color="#9ecae1", linewidth=0
        )
        above.stairs(scores, edges, baseline=None, color="#0072B2", linewidth=1.0)
        above.axhline(0.0, color="0.5", linewidth=0.5)

        # Draw the histogram of the samples below.
        counts, places = np.histogram(quantities[:, column], bins=20)
        below.stairs(counts, places, fill=True, color="0.6")
        below.set_xlabel(_with_unit(policy, column))
        below.set_yticks([])
    panels[0, 0].set_ylabel("adds to the target (rad)")
    panels[1, 0].set_ylabel("samples")
    figure.suptitle(title, fontsize=8)
    return figure


@styled
def pair_figure(policy: AdditivePolicy, pair: int, observations: Array, title: str) -> Figure:
    """Draws a function of two observations as a map (paper, Figure 8, bottom)."""
    units, columns = RobotUnits.of(policy.robot, policy.observation_names), policy.pairs[pair]
    cuts, quantities = units.quantities(policy.pair_cuts.T).T, units.quantities(observations)
    first, second = (_edges(cuts[column], quantities[:, column]) for column in columns)
    table = policy.pair_tables[pair, : len(first) - 1, : len(second) - 1]
    scores = policy.robot.action_scale * table

    # Scale the colours symmetrically about 0.
    reach = max(float(np.abs(scores).max()), 1e-9)
    figure, axes = subplots(figsize=(COLUMN_WIDTH, 2.6))
    image = axes.pcolormesh(
        first, second, scores.T, cmap="RdBu_r", vmin=-reach, vmax=reach, rasterized=True
    )
    axes.grid(visible=False)
    xlabel, ylabel = (_with_unit(policy, column) for column in columns)
    axes.set(xlabel=xlabel, ylabel=ylabel, title=title)
    figure.colorbar(image, ax=axes).set_label("adds to the target (rad)")
    return figure


@styled
def contribution_figure(contributions: Contributions, title: str, n_terms: int = 15) -> Figure:
    """Draws the terms of one target, the largest first, and their sum (paper, Figure 9)."""
    order = np.argsort(-np.abs(contributions.values), kind="stable")
    shown, rest = order[:n_terms], order[n_terms:]
    # List the largest terms, the sum of the others, and the sum of all.
    labels = [contributions.terms[index] for index in shown]
    values = contributions.values[shown].tolist()
    if len(rest):
        labels.append(f"{len(rest)} other terms")
        values.append(float(contributions.values[rest].sum()))
    labels.append("target")
    # Wrap long terms instead of cutting them.
    labels = [textwrap.fill(label, 64) for label in labels]
    n_lines = sum(label.count("\n") + 1 for label in labels)
    values.append(float(contributions.values.sum()))

    # Colour the bars by sign, except for the sum.
    colors = [POSITIVE if value > 0 else NEGATIVE for value in values]
    colors[-1] = NEUTRAL
    figure, axes = subplots(figsize=(1.5 * COLUMN_WIDTH, 0.7 + 0.16 * n_lines))
    axes.barh(range(len(labels)), values, color=colors)
    axes.axvline(0.0, color="0.2", linewidth=0.6)
    axes.set_yticks(range(len(labels)), labels, fontsize=6)
    axes.invert_yaxis()
    axes.set(xlabel="adds to the target (rad)", title=title)
    return figure


N_SHAPES, N_PAIRS = 3, 2  # functions of one and of two observations that are drawn for a joint


def student_figures(
    gait: str, kind: str, student: Policy, joint: int, observations: Array, seed: int = 0
) -> dict[str, Figure]:
    """Draws the model of a student's joint, if it has boosted trees or is an additive model.

    Names of figures begin with the kind and the joint. Averages are over the observations (m, n).
    """
    name = quadruped.JOINTS[joint]
    title = f"{gait.capitalize()}, {kind}, {name.replace('_', ' ')}"
    figures: dict[str, Figure] = {}
    match student:
        case BoostedTreesPolicy():
            ranked = np.argsort(-student.importances[joint], kind="stable")[:N_SHAPES]
            columns = tuple(int(column) for column in ranked)
            generator = np.random.default_rng([seed, 2])
            figures["tree"] = tree_figure(student, joint, observations)
            figures["partial_dependence"] = dependence_figure(
                student, joint, observations, columns, generator
            )
        case AdditivePolicy():
            # Terms are the intercept, all functions of one observation, and the joint's pairs.
            parts, n = student.explain(observations, joint), len(student.observation_names)
            ranked = np.argsort(-np.abs(parts.values[:, 1:]).mean(axis=0), kind="stable").tolist()
            singles = tuple(term for term in ranked if term < n)[:N_SHAPES]
            pairs = np.flatnonzero(student.pair_joints == joint)
            figures["terms"] = term_figure(parts, title)
            figures["shapes"] = shape_figure(student, joint, observations, singles, title)
            for place, term in enumerate([term for term in ranked if term >= n][:N_PAIRS], start=1):
                drawn = pair_figure(student, int(pairs[term - n]), observations, title)
                figures[f"pair_{place}"] = drawn
    return {f"{kind}_{name}_{what}": figure for what, figure in figures.items()}
