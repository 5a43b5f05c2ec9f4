"""The gymnasium environments."""

import warnings
from copy import deepcopy

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from glassgait.diagrams.gym import ENVIRONMENT_ID, LocomotionEnv, LocomotionVectorEnv
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.task.gait import load_gait
from glassgait.models.task.termination import FAILURES

ABRUPT = np.array([np.zeros(12), np.full(12, 10.0), np.zeros(12)])
"""Actions of three robots, of which the second ends its episode."""

JUSTIFIED = (
    # Velocities know no bound, and none of gymnasium's robots has any.
    "observation space minimum value is -infinity",
    "observation space maximum value is infinity",
    # Actions are those of the policies that ship; RescaleAction makes others of them.
    "recommend using a symmetric and normalized space",
)


def test_gymnasiums_checker_finds_nothing_but_the_spaces_bounds():
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        check_env(gymnasium.make(ENVIRONMENT_ID).unwrapped)
    reported = [str(warning.message) for warning in found if warning.category is UserWarning]
    assert [line for line in reported if not any(part in line for part in JUSTIFIED)] == []


def test_one_robot_and_many_observe_the_same():
    one, many = LocomotionEnv(load_gait("walk")), LocomotionVectorEnv(3, "walk")
    assert one.observation_space == many.single_observation_space
    assert one.reset(seed=0)[0].shape == (57,)
    assert many.reset(seed=0)[0].shape == (3, 57)


def test_arguments_that_fit_nothing_are_refused():
    for make in (LocomotionEnv, LocomotionVectorEnv):
        with pytest.raises(InputError, match="gait"):
            make(gait="moonwalk")


@pytest.mark.parametrize("engine", ["drake", "mujoco"])
def test_a_copy_goes_on_as_the_original_would(engine):
    station = StationConfig(time_step=0.005, engine=engine)
    one, many = LocomotionEnv(station=station), LocomotionVectorEnv(3, stations=[station])
    for env, action in ((one, np.full(12, 0.3)), (many, ABRUPT)):
        env.reset(seed=2)
        env.step(action)
        copy = deepcopy(env)
        found = [[own.step(action)[0] for _ in range(3)] for own in (env, copy)]
        np.testing.assert_array_equal(*found)


def test_a_seed_repeats_the_episodes():
    envs = LocomotionVectorEnv(3)

    def play(seed):
        observations = [envs.reset(seed=seed)[0]]
        return np.array(observations + [envs.step(0.5 * ABRUPT)[0] for _ in range(10)])

    first = play(5)
    np.testing.assert_array_equal(first, play(5))
    assert not np.array_equal(first, play(6))


def test_an_episode_that_ended_begins_anew_in_the_next_step():
    envs = gymnasium.make_vec(ENVIRONMENT_ID, num_envs=3)
    envs.reset(seed=0)
    _, reward, terminated, truncated, info = envs.step(ABRUPT)
    assert terminated.tolist() == [False, True, False] and not truncated.any()
    assert "abrupt_action" in info["failures"][1] and set(info["failures"][1]) <= set(FAILURES)
    assert np.all(reward[[0, 2]] == info["plain_reward"][[0, 2]])
    before = info["command"]
    observation, reward, terminated, _, info = envs.step(ABRUPT)
    assert not terminated.any()
    assert reward[1] == info["plain_reward"][1] == 0.0 and info["failures"][1] == ()
    np.testing.assert_array_equal(observation[:, :2], info["command"])
    assert np.any(info["command"][1] != before[1])
    assert envs.step(ABRUPT)[2].tolist() == [False, True, False]


def test_an_episode_is_truncated_after_its_steps():
    envs = gymnasium.make_vec(ENVIRONMENT_ID, num_envs=2, max_episode_steps=3)
    envs.reset(seed=0)
    truncated = [envs.step(np.zeros((2, 12)))[3].tolist() for _ in range(4)]
    assert truncated == [[False] * 2, [False] * 2, [True] * 2, [False] * 2]
