"""Policies that are saved, loaded again and compared."""

from typing import ClassVar

import numpy as np
import pytest

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.arrays import Reals
from glassgait.models.policies.library import POLICY_CLASSES, load_policy, save_policy
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.task.observation import ObservationLayout

NAMES = ObservationLayout(2).names


class Waves(Policy):
    """Acts by sines of the observations, and its file holds nothing."""

    kind = "waves"
    weights: Array

    def __init__(self, gait, observation_names, weights):
        super().__init__(gait, observation_names)
        self.weights = weights

    def __call__(self, observation):
        return np.sin(observation @ self.weights.T)


class StoredWaves(Waves):
    """Says what its file must hold."""

    kind = "stored_waves"
    array_specs: ClassVar = {"weights": Reals("joints observations")}

    def __init__(self, gait, observation_names, weights):
        Policy.__init__(self, gait, observation_names, weights=weights)


class ForgetfulPolicy(LinearPolicy):
    """Leaves out a part that it acts by."""

    kind = "forgetful"

    def __call__(self, observation):
        return super().__call__(observation) + getattr(self, "more", 0.0)


@pytest.fixture
def samples(generator):
    return generator.normal(size=(50, len(NAMES)))


@pytest.fixture
def weights(generator):
    return generator.normal(size=(12, len(NAMES)))


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    for one in (Waves, StoredWaves, ForgetfulPolicy):
        monkeypatch.setitem(POLICY_CLASSES, one.kind, one)


def test_a_class_of_a_user_is_saved_and_loaded_by_one_line(tmp_path, weights, samples):
    policy, path = StoredWaves("trot", NAMES, weights), tmp_path / "waves.safetensors"
    save_policy(policy, path, samples)
    loaded = load_policy(path)
    assert isinstance(loaded, StoredWaves)
    np.testing.assert_array_equal(loaded(samples), policy(samples))


def test_a_file_without_the_weights_is_refused_and_deleted(tmp_path, weights, samples):
    path = tmp_path / "waves.safetensors"
    with pytest.raises(InputError, match="to_arrays"):
        save_policy(Waves("trot", NAMES, weights), path, samples)
    assert not path.exists()


def test_a_policy_that_acts_otherwise_once_loaded_is_refused(tmp_path, weights, samples):
    path = tmp_path / "forgetful.safetensors"
    policy = ForgetfulPolicy("trot", NAMES, weights, np.zeros(12))
    save_policy(policy, path, samples)
    policy.more = 0.25  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(InputError, match=r"0\.25"):
        save_policy(policy, path, samples)
    assert not path.exists()


def test_a_class_that_is_not_registered_is_refused(tmp_path, weights, samples, monkeypatch):
    monkeypatch.delitem(POLICY_CLASSES, "stored_waves")
    with pytest.raises(InputError, match="stored_waves"):
        save_policy(StoredWaves("trot", NAMES, weights), tmp_path / "own.safetensors", samples)
