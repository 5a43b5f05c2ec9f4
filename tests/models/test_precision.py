"""Policies in single precision: what their files weigh, and that what is saved is what runs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from interpret.glassbox import ExplainableBoostingRegressor

from glassgait.models.files import load_arrays
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.arrays import lower_neighbours, narrowest, single_precision_cuts
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.library import load_policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names
N = len(NAMES)
LARGEST = 2_000_000
"""Bytes of a student that ships."""


def histogram_trees():
    """140 trees of depth 7 for each joint."""
    generator = np.random.default_rng(0)
    inner, leaves = (quadruped.N_JOINTS, 140, 127), (quadruped.N_JOINTS, 140, 128)
    return BoostedTreesPolicy(
        "trot",
        NAMES,
        features=generator.integers(N, size=inner),
        thresholds=np.where(generator.random(inner) < 0.1, np.inf, generator.normal(size=inner)),
        leaves=0.02 * generator.normal(size=leaves),
        intercepts=generator.normal(size=quadruped.N_JOINTS),
        importances=generator.random((quadruped.N_JOINTS, N)),
    )


def exact_trees():
    """The same, with thresholds of which scikit-learn's exact trees ask in single precision."""
    arrays, _ = histogram_trees().to_arrays()
    cuts = single_precision_cuts(arrays.pop("thresholds"))
    return BoostedTreesPolicy("trot", NAMES, thresholds=cuts, **arrays)


def additive(coarse=15):
    """128 bins of each observation, and 60 pairs a joint of 16 bins, in `coarse` + 1."""
    generator = np.random.default_rng(1)
    n_pairs, size = 60 * quadruped.N_JOINTS, coarse + 1
    # The last observation is in no pair.
    pairs = np.sort(generator.integers(N - 1, size=(n_pairs, 2)), axis=1)
    pair_cuts = np.full((N, coarse), np.inf)
    pair_cuts[:-1, :15] = np.sort(generator.normal(size=(N - 1, 15)), axis=1)
    pair_cuts[-1] = np.sort(generator.normal(size=coarse))
    table, pair_table = (quadruped.N_JOINTS, N, 128), (n_pairs, size, size)
    return AdditivePolicy(
        "trot",
        NAMES,
        cuts=np.sort(generator.normal(size=(N, 127)), axis=1),
        pair_cuts=pair_cuts,
        tables=0.1 * generator.normal(size=table),
        pairs=pairs,
        pair_joints=np.repeat(np.arange(quadruped.N_JOINTS), 60),
        pair_tables=0.1 * generator.normal(size=pair_table),
        deviations=0.01 * generator.random(table),
        pair_deviations=0.01 * generator.random(pair_table),
        intercepts=generator.normal(size=quadruped.N_JOINTS),
    )


def observations(count):
    return np.random.default_rng(2).normal(size=(count, N))


@pytest.mark.parametrize("make", [exact_trees, histogram_trees, additive])
def test_a_compact_policy_runs_as_it_is_saved(make, tmp_path):
    policy, path = make().compact(), tmp_path / "policy.safetensors"
    policy.save(path)
    assert path.stat().st_size < LARGEST
    loaded = load_policy(path)
    for own, other in zip(
        policy.to_arrays()[0].items(), loaded.to_arrays()[0].items(), strict=True
    ):
        assert own[0] == other[0]
        np.testing.assert_array_equal(own[1], other[1])
    rows = observations(500)
    np.testing.assert_array_equal(loaded(rows), policy(rows))
    assert policy(rows).dtype == np.float64


@pytest.mark.parametrize("make", [exact_trees, histogram_trees, additive])
def test_a_compact_policys_actions_differ_by_rounding(make):
    # Of trees by histograms, none of these observations lies within a rounding of a threshold.
    policy, rows = make(), observations(500)
    difference = np.abs(policy.compact()(rows) - policy(rows))
    assert 0 < difference.max() < 1e-6


def test_a_compact_policy_is_of_the_same_robot(small_trees, small_additive):
    for policy in (small_trees(), small_additive()):
        arrays = {name: getattr(policy, name) for name in policy.array_specs}
        own = type(policy)("trot", NAMES, robot=load_robot("go2"), **arrays)
        assert own.compact().robot.name == "go2"


def test_compact_exact_trees_take_every_branch_as_before():
    policy, rows = exact_trees(), observations(200)
    # Values that lie at thresholds, as counted ones do.
    at = policy.thresholds[0, :4].ravel()[:N]
    rows[::2] = np.where(np.isfinite(at), at, 0.0)
    rows[1::2] = np.nextafter(rows[::2], np.inf)
    np.testing.assert_array_equal(policy.compact().thresholds, policy.thresholds)
    np.testing.assert_allclose(policy.compact()(rows), policy(rows), rtol=0, atol=1e-6)


@given(arrays(np.float64, 3, elements=st.one_of(st.floats(-1e30, 1e30), st.just(np.inf))))
def test_thresholds_of_exact_trees_need_no_more_than_single_precision(thresholds):
    cuts = single_precision_cuts(thresholds)
    lower = lower_neighbours(cuts)
    assert lower is not None
    np.testing.assert_array_equal(single_precision_cuts(lower), cuts)


@given(st.floats(-1e6, 1e6), st.integers(-3, 3), st.sampled_from([-1, 0, 1]))
def test_cuts_part_doubles_as_rounding_to_single_precision_does(threshold, ulps, nudge):
    cut = single_precision_cuts(np.array(threshold))
    single = np.float32(threshold)
    for _ in range(abs(ulps)):
        single = np.nextafter(single, np.float32(np.copysign(np.inf, ulps)))
    neighbour = np.nextafter(single, np.float32(np.inf))
    halfway = 0.5 * (float(single) + float(neighbour))
    for x in (float(single), halfway, threshold, float(cut)):
        value = np.nextafter(x, np.copysign(np.inf, nudge)) if nudge else x
        assert (value <= cut) == (float(np.float32(value)) <= threshold)


@pytest.mark.parametrize("make", [exact_trees, histogram_trees, additive])
def test_a_policy_that_is_not_compact_is_saved_to_the_last_bit(make, tmp_path):
    policy, path, rows = make(), tmp_path / "policy.safetensors", observations(50)
    policy.save(path)
    np.testing.assert_array_equal(load_policy(path)(rows), policy(rows))


def test_observations_that_are_in_no_pair_do_not_widen_the_tables_of_pairs():
    policy, compact = additive(coarse=127), additive(coarse=127).compact()
    assert policy.pair_tables.shape[1:] == (128, 128)
    assert compact.pair_tables.shape[1:] == compact.pair_deviations.shape[1:] == (16, 16)
    rows = observations(500)
    np.testing.assert_allclose(compact(rows), policy(rows), rtol=0, atol=1e-6)


def test_compiled_tables_of_pairs_are_as_coarse_as_asked():
    rows = observations(300)
    targets = rows[:, 0] * rows[:, 1]
    model = ExplainableBoostingRegressor(
        feature_types=["continuous"] * N,
        outer_bags=1,
        interactions=1,
        max_bins=64,
        max_interaction_bins=8,
        max_rounds=5,
        n_jobs=1,
    ).fit(rows, targets)
    policy = AdditivePolicy.compile("trot", NAMES, [model] * quadruped.N_JOINTS)
    assert policy.tables.shape[-1] > 8
    assert max(policy.pair_tables.shape[1:]) <= 8
    np.testing.assert_allclose(policy(rows)[:, 0], model.predict(rows), rtol=0, atol=1e-12)


def test_numbers_are_written_no_wider_than_they_are(tmp_path):
    path = tmp_path / "policy.safetensors"
    additive().compact().save(path)
    written, _ = load_arrays(path)
    assert {name: array.dtype for name, array in written.items()} == {
        "cuts": np.float64,
        "pair_cuts": np.float64,
        "tables": np.float32,
        "pairs": np.uint8,
        "pair_joints": np.uint8,
        "pair_tables": np.float32,
        "deviations": np.float16,
        "pair_deviations": np.float16,
        "intercepts": np.float64,
    }


shapes = st.integers(0, 4)
doubles = st.one_of(st.floats(), st.floats(width=32), st.floats(width=16))


@given(
    st.one_of(
        arrays(np.float64, shapes, elements=doubles),
        arrays(np.int64, shapes, elements=st.integers(-(2**63), 2**63 - 1)),
        arrays(np.int64, shapes, elements=st.integers(-300, 300)),
    )
)
def test_narrowing_keeps_every_value(array):
    narrow = narrowest(array)
    np.testing.assert_array_equal(narrow, array)
    np.testing.assert_array_equal(np.signbit(narrow), np.signbit(array))
    assert narrow.dtype.kind in ("u" + array.dtype.kind)
