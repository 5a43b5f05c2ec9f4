"""Policies compiled from scikit-learn's and interpret's models equal them."""

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingRegressor

from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names


@pytest.fixture(scope="module")
def histogram_models(samples):
    observations, actions = samples()
    return [
        HistGradientBoostingRegressor(
            max_iter=10 + j % 2, max_leaf_nodes=9, random_state=j, early_stopping=False
        ).fit(observations, actions[:, j])
        for j in range(quadruped.N_JOINTS)
    ]


def test_boosted_trees_equal_scikit_learn(boosted_models, samples):
    observations, _ = samples(3000, seed=8)
    policy = BoostedTreesPolicy.compile("trot", NAMES, boosted_models)
    importances = [model.feature_importances_ for model in boosted_models]
    np.testing.assert_array_equal(policy.importances, importances)
    expected = np.stack([model.predict(observations) for model in boosted_models], axis=1)
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-12)


def test_boosted_trees_take_scikit_learns_branch_at_the_threshold(boosted_models, samples):
    observations, _ = samples(1, seed=8)
    tree = boosted_models[0].estimators_[0, 0].tree_
    at = np.repeat(observations, 3, axis=0)
    feature, threshold = tree.feature[0], tree.threshold[0]
    at[:, feature] = [threshold, np.nextafter(threshold, 9), np.nextafter(threshold, -9)]
    policy = BoostedTreesPolicy.compile("trot", NAMES, boosted_models)
    expected = np.stack([model.predict(at) for model in boosted_models], axis=1)
    np.testing.assert_allclose(policy(at), expected, rtol=0, atol=1e-12)


def test_histogram_trees_equal_scikit_learn(histogram_models, samples):
    observations, _ = samples(3000, seed=8)
    policy = BoostedTreesPolicy.compile("trot", NAMES, histogram_models)
    np.testing.assert_allclose(policy.importances.sum(axis=1), 1.0)
    expected = np.stack([model.predict(observations) for model in histogram_models], axis=1)
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-12)


def test_additive_equals_interpret_also_outside_the_training_range(additive_models, samples):
    observations, _ = samples(3000, seed=9)
    observations[:100] *= 10.0
    policy = AdditivePolicy.compile("trot", NAMES, additive_models)
    expected = np.stack([model.predict(observations) for model in additive_models], axis=1)
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-12)
    single = np.array([policy(row) for row in observations[:50]])
    np.testing.assert_allclose(single, expected[:50], rtol=0, atol=1e-12)


def test_bags_disagree_as_far_as_the_functions_that_apply_to_an_observation(random_additive):
    generator = np.random.default_rng(7)
    policy = random_additive(generator, n_pairs=9)
    policy.deviations[:] = generator.exponential(size=policy.deviations.shape)
    policy.pair_deviations[:] = generator.exponential(size=policy.pair_deviations.shape)
    observations = generator.normal(size=(4, 5, len(NAMES)))
    for row, message in zip(
        observations.reshape(20, -1), policy.disagreement(observations).ravel(), strict=True
    ):
        of_joints = np.zeros(quadruped.N_JOINTS)
        for entry, value in enumerate(row):
            bin_ = np.searchsorted(policy.cuts[entry], value, side="right")
            of_joints += policy.deviations[:, entry, bin_] ** 2
        for index, pair in enumerate(policy.pairs):
            bins = [np.searchsorted(policy.pair_cuts[n], row[n], side="right") for n in pair]
            of_joints[policy.pair_joints[index]] += policy.pair_deviations[index][tuple(bins)] ** 2
        assert message == pytest.approx(np.sqrt(of_joints.max()))


def test_one_model_agrees_with_itself(random_additive):
    generator = np.random.default_rng(7)
    policy = random_additive(generator, n_pairs=0)
    assert not policy.disagreement(generator.normal(size=(6, len(NAMES)))).any()
