"""What holds for every kind of policy: files, batches, and the law that each stands for."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.files import load_arrays, save_arrays
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.policies.library import load_policy
from glassgait.models.policies.neural import NeuralPolicy, elu
from glassgait.models.policies.policy import first_not_finite
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task.observation import ObservationLayout

A1 = load_robot()


NAMES = ObservationLayout(2).names


@pytest.fixture
def every_policy(
    neural,
    linear,
    statewise,
    symbolic,
    statewise_symbolic,
    open_loop,
    boosted_models,
    additive_models,
):
    """Policies of every kind."""
    return [
        neural,
        linear,
        statewise,
        symbolic,
        statewise_symbolic,
        open_loop,
        BoostedTreesPolicy.compile("trot", NAMES, boosted_models),
        AdditivePolicy.compile("trot", NAMES, additive_models),
    ]


def test_files_give_back_the_same_policy(every_policy, samples, tmp_path):
    observations, _ = samples(20, seed=5)
    for policy in every_policy:
        path = tmp_path / f"{policy.kind}{policy.suffix}"
        policy.save(path)
        loaded = load_policy(path)
        assert type(loaded) is type(policy)
        assert (loaded.gait, loaded.observation_names) == ("trot", NAMES)
        np.testing.assert_array_equal(loaded(observations), policy(observations))


def test_an_expert_that_observes_by_odometry_is_saved_with_its_gain(imu_expert, tmp_path):
    path = tmp_path / "expert.safetensors"
    imu_expert.save(path)
    loaded = load_policy(path)
    assert loaded.estimator == Odometry(gain=0.3)
    assert loaded.layout.imu and loaded.observation_names == imu_expert.observation_names
    rows = np.random.default_rng(1).normal(size=(5, loaded.layout.size))
    np.testing.assert_allclose(loaded(rows), imu_expert(rows), atol=1e-5)
    # Files hold single precision.
    loaded.save(tmp_path / "again.safetensors")
    assert load_policy(tmp_path / "again.safetensors").digest() == loaded.digest()
    other = NeuralPolicy("trot", loaded.observation_names, loaded.actor, Odometry(gain=0.2))
    assert other.digest() != loaded.digest()


@pytest.mark.parametrize("gain", [0, 2.0, "much", None])
def test_a_file_whose_odometry_is_none_is_refused(gain, imu_expert, tmp_path):
    path = tmp_path / "expert.safetensors"
    imu_expert.save(path)
    arrays, header = load_arrays(path)
    header["values"]["odometry"] = {"gain": gain}
    save_arrays(path, arrays, header)
    with pytest.raises(InputError, match="odometry"):
        load_policy(path)


def test_a_file_says_how_joints_follow(every_policy, tmp_path):
    law = JointLaw((40.0, 1.0), limited=True)
    for policy in every_policy:
        own = policy.with_joint_law(law)
        path = tmp_path / f"own{own.suffix}"
        own.save(path)
        assert load_policy(path).joint_law == law
        assert own.digest() != policy.digest() == own.with_joint_law(policy.joint_law).digest()


@pytest.mark.parametrize("law", [{"gains": [0, 1]}, {"gains": [40]}, {"limited": 1}, {"p": 40}, 40])
def test_a_file_whose_joint_law_is_none_is_refused(law, imu_expert, tmp_path):
    path = tmp_path / "expert.safetensors"
    imu_expert.save(path)
    arrays, header = load_arrays(path)
    save_arrays(path, arrays, header | {"joint_law": law})
    with pytest.raises(InputError, match="joint_law"):
        load_policy(path)


def test_batches_agree_with_single_rows(every_policy, samples):
    observations, _ = samples(12, seed=6)
    for policy in every_policy:
        batch = policy(observations.reshape(3, 4, -1))
        assert batch.shape == (3, 4, 12)
        single = np.array([policy(row) for row in observations])
        np.testing.assert_allclose(batch.reshape(12, 12), single, rtol=0, atol=1e-12)


def test_statewise_formulas_are_those_of_the_state(statewise_symbolic, samples):
    observations, _ = samples(2, seed=4)
    policy = statewise_symbolic
    observations[:, policy._one_hot] = np.eye(2)
    values = policy.quantities(observations)
    targets = A1.joint_targets(policy(observations))
    joint = np.arange(12)
    np.testing.assert_allclose(targets[0], 1 + values[0, joint] * values[0, joint + 1])
    np.testing.assert_allclose(targets[1], 2 + values[1, joint] * values[1, joint + 2])


def test_open_loop_actions_are_looked_up_and_held_at_the_end(open_loop, samples):
    policy = open_loop
    observations, _ = samples(3, seed=4)
    observations[:, policy._one_hot] = [[1, 0], [0, 1], [0, 1]]
    observations[:, NAMES.index("RM Iters")] = [0.3, 0.0, 2.5]
    expected = policy.table[[0, 1, 1], [3, 0, 5]]
    np.testing.assert_array_equal(policy(observations), expected)


def test_statewise_linear_uses_the_weights_of_its_state(statewise, samples):
    policy = statewise
    observations, _ = samples(2, seed=4)
    observations[:, policy._one_hot] = np.eye(2)
    for state in range(2):
        expected = policy.weights[state] @ observations[state] + 1.0
        np.testing.assert_allclose(policy(observations)[state], expected)


def test_neural_network_is_a_perceptron_with_elu(neural, samples):
    policy = neural
    observation = samples(1)[0][0]
    hidden = elu(policy.actor.weights[0] @ observation + policy.actor.biases[0])
    np.testing.assert_allclose(policy(observation), policy.actor.weights[1] @ hidden)
    np.testing.assert_allclose(elu(np.array([-1.0, 2.0])), [np.exp(-1) - 1, 2.0])


@pytest.mark.parametrize("real", [np.float16, np.float32])
@pytest.mark.parametrize("whole", [np.uint8, np.uint16, np.int64])
def test_small_types_of_numbers_are_taken(
    real, whole, linear, open_loop, small_trees, small_additive, neural, samples, tmp_path
):
    for policy in (linear, open_loop, small_trees(), small_additive(), neural):
        path = tmp_path / "policy.safetensors"
        policy.save(path)
        arrays, header = load_arrays(path)
        small = {
            name: array.astype(real if array.dtype.kind == "f" else whole)
            for name, array in arrays.items()
        }
        save_arrays(path, small, header)
        action = load_policy(path)(samples(5)[0])
        assert action.dtype == np.float64
        np.testing.assert_allclose(action, policy(samples(5)[0]), rtol=0, atol=0.1)


def test_the_first_entry_that_is_not_finite_is_found():
    values = np.zeros((2, 12))
    assert first_not_finite(values) is None
    values[1, 3], values[1, 7] = np.inf, np.nan
    assert first_not_finite(values) == (1, 3)
    assert first_not_finite(values[1]) == (3,)
