"""Gymnasium's faces of the task."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from glassgait.diagrams.gym import LocomotionEnv, LocomotionVectorEnv
from glassgait.models.task.gait import load_gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.termination import FAILURES


@pytest.fixture(scope="module")
def env():
    return LocomotionEnv(load_gait("trot"))


def test_gymnasiums_checker_finds_nothing_but_the_spaces_bounds(env):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)
    told = [str(warning.message) for warning in found if warning.category is UserWarning]
    assert told
    expected = ("infinity", "recommend using a symmetric and normalized space")
    assert [line for line in told if not any(part in line for part in expected)] == []


def test_a_seed_repeats_the_episode_and_those_after_it(env):
    def play():
        observations = [env.reset(seed=3)[0]]
        for _ in range(2):
            for _ in range(5):
                observations.append(env.step(np.full(12, 0.1))[0])
            observations.append(env.reset()[0])
        return np.array(observations)

    first = play()
    np.testing.assert_array_equal(first, play())
    assert not np.array_equal(first[0], first[6])


def test_a_fall_terminates_and_is_named(env):
    env.reset(seed=0)
    for _ in range(200):
        *_, terminated, truncated, info = env.step(np.full(12, 8.0))
        if terminated:
            break
    assert terminated
    assert not truncated
    assert set(info["failures"]) <= set(FAILURES)


def test_vector_env_autoresets_in_the_same_step(trot):
    envs = LocomotionVectorEnv(trot, 3)
    assert envs.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    envs.reset(seed=0)
    actions = np.zeros((3, 12))
    actions[1] = 10.0
    observation, reward, terminated, truncated, info = envs.step(actions)
    assert terminated.tolist() == [False, True, False]
    assert info["_final_obs"].tolist() == [False, True, False]
    assert info["final_obs"][0] is None
    previous_action = slice(26, 38)
    np.testing.assert_array_equal(info["final_obs"][1][previous_action], 10.0)
    np.testing.assert_array_equal(observation[1][previous_action], 0.0)
    assert observation in envs.observation_space
    assert reward.shape == truncated.shape == (3,)


def test_vector_env_repeats_with_its_seed(trot):
    envs = LocomotionVectorEnv(trot, 3)
    first, _ = envs.reset(seed=5)
    again, _ = envs.reset(seed=5)
    other, _ = envs.reset(seed=6)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def playing(**changes):
    quiet = {
        "joint_scale": (1.0, 1.0),
        "base_velocity": 0.0,
        "friction": (1.0, 1.0),
        "push_speed": 0.0,
        "observation_noise": 0.0,
    }
    return LocomotionEnv(load_gait("trot"), randomization=Randomization(**{**quiet, **changes}))


BASE_VELOCITY = slice(42, 45)


def test_friction_is_drawn_for_every_episode():
    slips = {}
    for friction in (0.0, 1.0):
        env = playing(friction=(friction, friction), base_velocity=1.0)
        env.reset(seed=1)
        for _ in range(15):
            observation, *_ = env.step(np.zeros(12))
        slips[friction] = np.linalg.norm(observation[BASE_VELOCITY][:2])
    assert slips[0.0] > 2 * slips[1.0]


def test_pushes_show_in_the_observation_and_not_in_the_reward():
    pushed, quiet = (playing(push_speed=speed, push_interval=0.02) for speed in (1.0, 0.0))
    for env in (pushed, quiet):
        env.reset(seed=1)
    (first, reward, *_), (calm, same, *_) = (env.step(np.zeros(12)) for env in (pushed, quiet))
    assert np.abs(first - calm)[BASE_VELOCITY].max() > 0.1
    np.testing.assert_array_equal(np.delete(first - calm, np.r_[BASE_VELOCITY]), 0.0)
    assert reward == same


def test_noise_follows_its_factor():
    first = {
        factor: playing(observation_noise=factor).reset(seed=1)[0] for factor in (0.0, 1.0, 2.0)
    }
    noise = first[1.0] - first[0.0]
    assert np.abs(noise).max() > 0.01
    np.testing.assert_allclose(first[2.0] - first[0.0], 2.0 * noise, atol=1e-12)
