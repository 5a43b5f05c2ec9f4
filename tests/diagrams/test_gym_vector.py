"""Gymnasium's face of many robots in batch."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

import glassgait.diagrams.gym.rendering
from glassgait.diagrams.gym import LocomotionEnv, LocomotionVectorEnv
from glassgait.models.errors import InputError
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.termination import FAILURES

ID = "glassgait/Locomotion-v0"
YAW = 1
PREVIOUS_ACTION = slice(26, 38)

ABRUPT = np.zeros((3, 12))
ABRUPT[1] = 10.0
"""Ends the second robot's episode at once."""


class StandIn:
    """A camera that needs no EGL."""

    def __init__(self, robot):
        self.robot = robot

    def take(self, state):
        return np.full((4, 6, 3), 128, dtype=np.uint8)


@pytest.fixture
def camera(monkeypatch):
    monkeypatch.setattr(glassgait.diagrams.gym.rendering, "Camera", StandIn)
    monkeypatch.setattr(glassgait.diagrams.gym.rendering, "check_egl", lambda: None)


@pytest.fixture
def envs():
    return LocomotionVectorEnv(3)


def test_an_episode_begins_in_the_step_after_the_last(envs):
    envs.reset(seed=0)
    last, _, terminated, truncated, info = envs.step(ABRUPT)
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert info["failures"][0] == ()
    assert "abrupt_action" in info["failures"][1]
    np.testing.assert_array_equal(last[1][PREVIOUS_ACTION], 10.0)

    first, reward, terminated, truncated, info = envs.step(ABRUPT)
    assert not terminated.any()
    assert not truncated.any()
    assert reward[1] == info["plain_reward"][1] == 0.0
    assert info["failures"][1] == ()
    # The action is ignored, and the episode is drawn anew.
    np.testing.assert_array_equal(first[1][PREVIOUS_ACTION], 0.0)
    assert first[1][YAW] != last[1][YAW]
    assert envs.step(ABRUPT)[2].tolist() == [False, True, False]


def test_an_episode_can_begin_in_the_same_step():
    envs = LocomotionVectorEnv(3, autoreset_mode="SameStep")
    assert envs.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP
    assert LocomotionVectorEnv.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    envs.reset(seed=0)
    observation, _, terminated, _, info = envs.step(ABRUPT)
    assert terminated.tolist() == [False, True, False]
    assert info["_final_obs"].tolist() == [False, True, False]
    assert info["_final_info"].tolist() == [False, True, False]
    assert info["final_obs"][0] is None
    np.testing.assert_array_equal(info["final_obs"][1][PREVIOUS_ACTION], 10.0)
    assert "abrupt_action" in info["final_info"]["failures"][1]
    assert info["failures"][1] == ()
    np.testing.assert_array_equal(observation[1][PREVIOUS_ACTION], 0.0)
    np.testing.assert_array_equal(observation[:, :2], info["command"])
    assert info["command"][1, YAW] != info["final_info"]["command"][1, YAW]


def test_the_last_step_of_an_episode_is_paid_in_every_mode():
    paid = []
    for mode in AutoresetMode:
        envs = LocomotionVectorEnv(8, max_episode_steps=1, autoreset_mode=mode)
        envs.reset(seed=0)
        _, reward, _, truncated, info = envs.step(np.zeros((8, 12)))
        assert truncated.all()
        paid.append([reward, info.get("final_info", info)["plain_reward"]])
    np.testing.assert_array_equal(paid[0], paid[1])
    np.testing.assert_array_equal(paid[0], paid[2])
    assert np.any(paid, axis=-1).all()


def test_robots_can_be_left_to_be_reset_by_hand():
    envs = LocomotionVectorEnv(3, autoreset_mode=AutoresetMode.DISABLED)
    before, _ = envs.reset(seed=0)
    ended = envs.step(ABRUPT)[2]
    with pytest.raises(ResetNeeded, match=r"\[1\]"):
        envs.step(ABRUPT)
    standing = envs._simulator.state.plant.copy()
    after, info = envs.reset(options={"reset_mask": ended})
    assert info["_command"].tolist() == [False, True, False]
    np.testing.assert_array_equal(envs._simulator.state.plant[[0, 2]], standing[[0, 2]])
    np.testing.assert_array_equal(after[[0, 2], :2], before[[0, 2], :2])
    assert after[1, YAW] != before[1, YAW]
    envs.step(np.zeros((3, 12)))


@pytest.mark.parametrize("mask", [[True], np.zeros(3, dtype=bool), np.ones(3), "all"])
def test_what_is_no_reset_mask_is_refused(envs, mask):
    with pytest.raises(InputError, match="booleans"):
        envs.reset(options={"reset_mask": mask})


def test_an_episode_is_truncated_after_its_steps():
    envs = gymnasium.make_vec(ID, num_envs=2, max_episode_steps=3)
    envs.reset(seed=0)
    truncated = [envs.step(np.zeros((2, 12)))[3].tolist() for _ in range(4)]
    assert truncated == [[False] * 2, [False] * 2, [True] * 2, [False] * 2]


def test_a_seed_repeats_the_episodes(envs):
    def play(seed):
        observations = [envs.reset(seed=seed)[0]]
        return np.array(observations + [envs.step(0.5 * ABRUPT)[0] for _ in range(10)])

    first = play(5)
    np.testing.assert_array_equal(first, play(5))
    assert not np.array_equal(first, play(6))


@pytest.mark.parametrize("number", [0, -1, 2.5, True, None])
def test_a_number_of_robots_is_one_or_more(number):
    with pytest.raises(InputError, match="num_envs"):
        gymnasium.make_vec(ID, num_envs=number)


@pytest.mark.parametrize("senses", ["odometry", "imu"])
def test_one_robot_and_many_observe_by_the_same_senses(senses):
    quiet = replace(NOMINAL, observation_noise=0.0, joint_scale=(1.0, 1.0), base_velocity=0.0)
    one = LocomotionEnv(randomization=quiet, senses=senses)
    many = LocomotionVectorEnv(2, randomization=quiet, senses=senses)
    action = 0.3 * np.random.default_rng(3).normal(size=12)
    (first, _), (rows, _) = one.reset(seed=1), many.reset(seed=1)
    for _ in range(8):
        assert first in one.observation_space and rows in many.observation_space
        # Commands and rhythm are each its own.
        np.testing.assert_allclose(first[2:-7][:24], rows[0, 2:26], atol=1e-9)
        np.testing.assert_allclose(first[-7:], rows[0, -7:], atol=1e-9)
        first, *_ = one.step(action)
        rows, *_ = many.step(np.tile(action, (2, 1)))
    assert np.any(first[-7:-4] != 0.0)
    truth = LocomotionEnv().observation_space.shape[0]
    assert one.observation_space.shape == (truth + (6 if senses == "imu" else 0),)


@pytest.mark.parametrize("make", [LocomotionEnv, LocomotionVectorEnv])
def test_senses_that_are_none_are_refused(make):
    with pytest.raises(InputError, match="senses"):
        make(senses="sixth")


def test_arguments_that_fit_nothing_are_refused():
    for argument in ("autoreset_mode", "render_mode"):
        with pytest.raises(InputError, match=f"{argument} is 'never'; give"):
            LocomotionVectorEnv(2, **{argument: "never"})
    with pytest.raises(InputError, match="episode_steps"):
        LocomotionVectorEnv(2, max_episode_steps=0)


def test_nothing_goes_before_the_first_reset(envs):
    some = {"reset_mask": np.array([True, False, False])}
    for ask in (
        lambda: envs.step(np.zeros((3, 12))),
        envs.render,
        lambda: envs.reset(options=some),
    ):
        with pytest.raises(ResetNeeded, match=r"call reset\(\) first"):
            ask()


def test_what_are_no_actions_is_refused_and_changes_nothing(envs):
    envs.reset(seed=0)
    lost = np.zeros((3, 12))
    lost[2, 4] = np.nan
    for actions, message in [
        (lost, r"nan at \(2, 4\)"),
        (np.zeros((2, 12)), r"shape \(2, 12\); give them in shape \(3, 12\)"),
        (np.zeros(12), r"shape \(12,\)"),
        ([["walk"] * 12] * 3, "no array of numbers"),
    ]:
        with pytest.raises(InputError, match=message):
            envs.step(actions)
    after, *_ = envs.step(np.zeros((3, 12)))
    envs.reset(seed=0)
    np.testing.assert_array_equal(after, envs.step(np.zeros((3, 12)))[0])


def shape_of(info):
    """Tells how an info is built: its keys, and the kinds and shapes of its arrays."""
    return {
        key: shape_of(value) if isinstance(value, dict) else (value.dtype.kind, value.shape)
        for key, value in info.items()
    }


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_batch_answers_as_gymnasiums_own_vectors_do(mode):
    batch = gymnasium.make_vec(ID, num_envs=3, autoreset_mode=mode)
    sync = gymnasium.make_vec(
        ID, num_envs=3, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}
    )
    assert batch.metadata == sync.metadata
    for name in ("observation_space", "action_space"):
        for space in (name, f"single_{name}"):
            assert getattr(batch, space) == getattr(sync, space)
            assert type(getattr(batch, space)) is type(getattr(sync, space))
    answers = []
    for envs in (batch, sync):
        answers.append([envs.reset(seed=0), envs.step(ABRUPT)])
        if mode != AutoresetMode.DISABLED:
            answers[-1].append(envs.step(0.0 * ABRUPT))
    for ours, theirs in zip(*answers, strict=True):
        for mine, own in zip(ours[:-1], theirs[:-1], strict=True):
            assert (mine.dtype, mine.shape) == (own.dtype, own.shape)
        assert shape_of(ours[-1]) == shape_of(theirs[-1])
    assert answers[0][1][2].tolist() == answers[1][1][2].tolist() == [False, True, False]


def test_what_is_returned_is_not_used_again(envs):
    kept = [envs.reset(seed=0)] + [envs.step(ABRUPT) for _ in range(3)]
    arrays = [
        array
        for answer in kept
        for array in (*answer[:-1], *answer[-1].values())
        if isinstance(array, np.ndarray)
    ]
    for i, one in enumerate(arrays):
        assert not any(np.shares_memory(one, other) for other in arrays[:i])


def test_wrappers_of_vectors_work():
    envs = gymnasium.make_vec(ID, num_envs=3, max_episode_steps=2)
    envs = wrappers.RecordEpisodeStatistics(envs)
    envs = wrappers.RescaleAction(envs, -1.0, 1.0)
    envs = wrappers.ClipAction(envs)
    envs = wrappers.FlattenObservation(envs)
    envs = wrappers.NormalizeObservation(envs)
    envs = wrappers.NormalizeReward(envs)
    envs = wrappers.DictInfoToList(envs)
    observations, _ = envs.reset(seed=0)
    assert observations.shape == (3, 49)
    for _ in range(2):
        observations, *_, infos = envs.step(np.zeros((3, 12)))
    assert [info["episode"]["l"] for info in infos] == [2, 2, 2]
    assert [info["failures"] for info in infos] == [(), (), ()]
    assert abs(observations).max() < 10


def test_every_robot_has_its_picture(camera):
    envs = gymnasium.make_vec(ID, num_envs=3, render_mode="rgb_array")
    envs.reset(seed=0)
    pictures = envs.render()
    assert [picture.shape for picture in pictures] == [(4, 6, 3)] * 3
    envs.close()
    envs.close()
    with pytest.warns(UserWarning, match="without a render mode"):
        quiet = LocomotionVectorEnv(3)
        quiet.reset(seed=0)
        assert quiet.render() is None


def test_a_video_of_all_is_recorded(camera, tmp_path):
    pytest.importorskip("moviepy", reason="RecordVideo needs moviepy")
    envs = gymnasium.make_vec(ID, num_envs=4, max_episode_steps=3, render_mode="rgb_array")
    envs = wrappers.RecordVideo(envs, str(tmp_path / "video"))
    envs.reset(seed=0)
    for _ in range(5):
        envs.step(np.zeros((4, 12)))
    envs.close()
    assert {path.suffix for path in (tmp_path / "video").iterdir()} == {".mp4"}


def test_single_robots_run_in_processes():
    envs = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="async", gait="walk")
    try:
        first, _ = envs.reset(seed=0)
        again, _ = envs.reset(seed=0)
        np.testing.assert_array_equal(first, again)
        _, _, terminated, _, info = envs.step(np.array([np.zeros(12), np.full(12, 10.0)]))
        assert terminated.tolist() == [False, True]
        assert "abrupt_action" in info["failures"][1]
        assert set(info["failures"][1]) <= set(FAILURES)
    finally:
        envs.close()
        envs.close()
