"""Additive policies as interpret's models, so that its explanations and its dashboard read them."""

from typing import Any

import numpy as np
from interpret.glassbox import ExplainableBoostingRegressor
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.policies.additive import AdditivePolicy

HISTOGRAM_BINS = 20


def interpret_model(
    policy: AdditivePolicy, joint: int, observations: Array
) -> ExplainableBoostingRegressor:
    """Rebuilds the fitted model of a joint.

    Its `explain_global` and `explain_local` return interpret's explanation objects, which
    `interpret.show` takes.

    Args:
        policy: The additive policy.
        joint: Index of the joint.
        observations: Observations (m, n); their density stands below each function and weighs the
            terms' importances.
    """
    model: Any = ExplainableBoostingRegressor(feature_names=list(policy.observation_names))
    n = len(policy.observation_names)
    cuts, pair_cuts = _trimmed(policy.cuts), _trimmed(policy.pair_cuts)
    singles = [(feature,) for feature in range(n)]
    mine = np.flatnonzero(policy.pair_joints == joint)
    pairs = [tuple(policy.pairs[index].tolist()) for index in mine]

    model.bins_ = [[fine, coarse] for fine, coarse in zip(cuts, pair_cuts, strict=True)]
    model.term_features_ = singles + pairs
    model.term_names_ = list(policy.term_names(joint))
    for attribute, single, paired in (
        ("term_scores_", policy.tables[joint], policy.pair_tables[mine]),
        ("standard_deviations_", policy.deviations[joint], policy.pair_deviations[mine]),
    ):
        values = [single[feature, : len(cuts[feature]) + 1] for feature in range(n)]
        values += [
            table[: len(pair_cuts[first]) + 1, : len(pair_cuts[second]) + 1]
            for (first, second), table in zip(pairs, paired, strict=True)
        ]
        setattr(model, attribute, [_with_ends(value) for value in values])
    model.bin_weights_ = [
        _counts(observations[:, term], [(cuts, pair_cuts)[len(term) - 1][f] for f in term])
        for term in model.term_features_
    ]
    histograms = [np.histogram(column, HISTOGRAM_BINS) for column in observations.T]
    model.histogram_weights_ = [_with_ends(counts) for counts, _ in histograms]
    model.histogram_edges_ = [edges for _, edges in histograms]
    model.feature_bounds_ = np.stack([observations.min(axis=0), observations.max(axis=0)], axis=1)
    model.feature_names_in_ = list(policy.observation_names)
    model.feature_types_in_ = ["continuous"] * n
    model.n_features_in_ = n
    model.intercept_ = float(policy.intercepts[joint])
    model.link_, model.link_param_ = "identity", np.nan
    model.has_fitted_ = True
    return model


def _trimmed(padded: Array) -> list[Array]:
    return [row[np.isfinite(row)] for row in padded]


def _with_ends(values: NDArray[Any]) -> Array:
    """Adds interpret's bins for missing and for unseen values, which are never used here."""
    return np.pad(values.astype(float), 1)


def _counts(columns: Array, cuts: list[Array]) -> Array:
    bins = [
        np.searchsorted(own, column, side="right")
        for own, column in zip(cuts, columns.T, strict=True)
    ]
    counts = np.zeros([len(own) + 1 for own in cuts])
    np.add.at(counts, tuple(bins), 1.0)
    return _with_ends(counts)
