"""The space of actions: what the experts do, and what random policies survive."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector.utils import batch_space

from glassgait.diagrams.gym import ActionSpace, LocomotionVectorEnv, action_space
from glassgait.models.policies.library import load_expert, shipped_experts

SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    "gait",
    [gait if gait == "trot" else pytest.param(gait, marks=SLOW) for gait in shipped_experts()],
)
def test_experts_stay_inside(gait):
    expert = load_expert(gait)
    envs = LocomotionVectorEnv(16, gait, senses="imu")
    observations, _ = envs.reset(seed=0)
    greatest = 0.0
    for _ in range(100):
        actions = expert(observations)
        assert actions in envs.action_space
        greatest = max(greatest, abs(actions).max())
        observations, *_ = envs.step(actions)
    assert greatest > 3.0


def test_a_random_policy_survives():
    envs = LocomotionVectorEnv(32)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    survived = np.zeros(32)
    alive = np.ones(32, dtype=bool)
    for _ in range(40):
        *_, terminated, _, _ = envs.step(envs.action_space.sample())
        alive &= ~terminated
        survived += alive
    assert np.median(survived) == 40
    assert np.mean(survived >= 2) > 0.9


def test_uniform_actions_that_hold_the_experts_would_not_survive():
    envs = LocomotionVectorEnv(16)
    envs.reset(seed=0)
    uniform = gymnasium.spaces.Box(-5.2, 5.2, (16, 12), np.float64, seed=0)
    *_, terminated, _, info = envs.step(uniform.sample())
    assert terminated.mean() > 0.9
    assert all("abrupt_action" in shown for shown in info["failures"][terminated])


def test_samples_follow_the_seed_in_every_form_of_the_space():
    for space in (action_space(), batch_space(action_space(), 4)):
        copied = pickle.loads(pickle.dumps(space))
        assert isinstance(space, ActionSpace)
        space.seed(3)
        copied.seed(3)
        samples = np.array([space.sample() for _ in range(200)])
        assert all(sample in space for sample in samples)
        np.testing.assert_array_equal(samples[0], copied.sample())
        assert 0.9 < samples.std() < 1.1
        assert not np.array_equal(samples[0], samples[1])
    assert batch_space(action_space(), 4).shape == (4, 12)
