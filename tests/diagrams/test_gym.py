"""Gymnasium's face of one robot, and what both environments are registered as."""

import json
import os
import pickle
import subprocess
import sys
import warnings
from copy import deepcopy

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import glassgait.diagrams.gym.rendering
from glassgait.diagrams.egl import check_egl
from glassgait.diagrams.gym import LocomotionEnv, LocomotionVectorEnv
from glassgait.models.errors import InputError
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait
from glassgait.models.task.randomization import Randomization
from glassgait.models.task.termination import FAILURES

ID = "glassgait/Locomotion-v0"


class StandIn:
    """A camera that needs no EGL: its pictures show how far the robot is."""

    def __init__(self, robot):
        self.robot = robot

    def take(self, state):
        return np.full((4, 6, 3), abs(round(100 * state[4])), dtype=np.uint8)


@pytest.fixture
def camera(monkeypatch):
    monkeypatch.setattr(glassgait.diagrams.gym.rendering, "Camera", StandIn)
    monkeypatch.setattr(glassgait.diagrams.gym.rendering, "check_egl", lambda: None)


@pytest.fixture(scope="module")
def env():
    return LocomotionEnv()


def reported_by_checker(env):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        check_env(env)
    return [str(warning.message) for warning in found if warning.category is UserWarning]


JUSTIFIED = (
    # Velocities know no bound, and none of gymnasium's own robots has any.
    "observation space minimum value is -infinity",
    "observation space maximum value is infinity",
    # Actions are those of the policies that ship; RescaleAction makes others of them.
    "recommend using a symmetric and normalized space",
)


def test_gymnasiums_checker_finds_nothing_but_the_spaces_bounds(camera):
    reported = reported_by_checker(gymnasium.make(ID).unwrapped)
    assert len(reported) == len(JUSTIFIED)
    assert [line for line in reported if not any(part in line for part in JUSTIFIED)] == []


@pytest.mark.slow
def test_the_id_is_known_once_the_module_is_named():
    code = (
        "import gymnasium; env = gymnasium.make('glassgait.diagrams.gym:glassgait/Locomotion-v0'); "
        "env.reset(seed=0); env.step(env.action_space.sample()); "
        "print(env.spec.id, env.spec.max_episode_steps, type(env.unwrapped).__name__)"
    )
    reported = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert reported.stdout.split() == [ID, "1000", "LocomotionEnv"]
    assert reported.stderr == ""


def test_many_robots_are_made_in_batch():
    envs = gymnasium.make_vec(ID, num_envs=16, gait="walk")
    assert isinstance(envs, LocomotionVectorEnv)
    assert envs.spec.id == ID
    assert envs.reset(seed=0)[0].shape == (16, 51)


def test_a_spec_is_copied_and_makes_the_same_environment():
    spec = gymnasium.make(ID, gait="walk").spec
    read = EnvSpec.from_json(spec.to_json())
    assert json.loads(spec.to_json())["kwargs"] == {"gait": "walk"}
    for copied in (pickle.loads(pickle.dumps(spec)), deepcopy(spec), read):
        assert gymnasium.make(copied).observation_space.shape == (51,)
        assert gymnasium.make_vec(copied, num_envs=2).observation_space.shape == (2, 51)


def test_gaits_are_given_by_name_file_or_themselves(tmp_path, env):
    own = tmp_path / "own.yaml"
    own.write_text((GAIT_DIRECTORY / "walk.yaml").read_text())
    for make in (LocomotionEnv, lambda gait: LocomotionVectorEnv(2, gait)):
        for gait in ("walk", str(own), own, load_gait("walk")):
            assert make(gait).observation_space.shape[-1] == 51
        for wrong in ("moonwalk", 3, None):
            with pytest.raises(InputError, match="gait"):
                make(wrong)
    assert env.observation_space.shape == (49,)


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


@pytest.mark.parametrize("asked", ["step", "render"])
def test_nothing_goes_before_the_first_reset(asked):
    env = LocomotionEnv()
    with pytest.raises(ResetNeeded, match=r"call reset\(\) first"):
        env.step(np.zeros(12)) if asked == "step" else env.render()


@pytest.mark.parametrize(
    ("action", "reported"),
    [
        (np.full(12, np.nan), "nan at"),
        (np.r_[np.zeros(11), np.inf], r"inf at \(11,\)"),
        (np.zeros(11), r"shape \(11,\); give them in shape \(12,\)"),
        (0.0, r"shape \(\)"),
        ("walk", "no array of numbers"),
    ],
)
def test_what_is_no_action_is_refused_and_changes_nothing(env, action, reported):
    env.reset(seed=0)
    with pytest.raises(InputError, match=reported):
        env.step(action)
    after, *_ = env.step(np.zeros(12))
    env.reset(seed=0)
    np.testing.assert_array_equal(after, env.step(np.zeros(12))[0])


def test_pictures_follow_the_render_mode(camera):
    env = gymnasium.make(ID, render_mode="rgb_array")
    env.reset(seed=0)
    assert env.render().shape == (4, 6, 3)
    listed = gymnasium.make(ID, render_mode="rgb_array_list")
    listed.reset(seed=0)
    listed.step(np.zeros(12))
    assert len(listed.render()) == 2
    assert env.metadata["render_fps"] == 50
    with pytest.raises(InputError, match="ansi"):
        LocomotionEnv(render_mode="ansi")


@pytest.mark.slow
def test_the_camera_sees_every_robot():
    # Not asked before all tests are imported: once Mesa has loaded its LLVM, importing Triton,
    # which PyTorch with CUDA brings, ends the process.
    try:
        check_egl()
    except InputError:
        pytest.skip("rendering needs EGL (Debian: libegl1, libgl1-mesa-dri)")
    envs = gymnasium.make_vec(ID, num_envs=2, render_mode="rgb_array")
    envs.reset(seed=0)
    for picture in envs.render():
        assert picture.shape == (360, 640, 3)
        assert picture.dtype == np.uint8
        # The robot is black.
        assert 0.005 < (picture.max(axis=2) < 60).mean() < 0.5


def test_nothing_is_drawn_without_a_render_mode(env):
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="without a render mode"):
        assert env.render() is None


@pytest.mark.skipif(sys.platform != "linux", reason="Drake draws by EGL on Linux alone")
def test_a_machine_without_egl_is_refused(tmp_path):
    code = (
        "import gymnasium\nfrom glassgait.models.errors import InputError\n"
        "for make in (gymnasium.make, gymnasium.make_vec):\n"
        f"    try:\n        make('glassgait.diagrams.gym:{ID}', render_mode='rgb_array')\n"
        "    except InputError as error:\n        print(error)"
    )
    reported = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"__EGL_VENDOR_LIBRARY_DIRS": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    one, several = reported.stdout.splitlines()
    assert one == several
    assert one.startswith("rendering: EGL cannot open a display; install it")


def test_wrappers_of_one_robot_work(camera):
    env = gymnasium.make(ID, max_episode_steps=3, render_mode="rgb_array")
    env = wrappers.RecordEpisodeStatistics(wrappers.FlattenObservation(env))
    env = wrappers.NormalizeObservation(wrappers.RescaleAction(env, -1.0, 1.0))
    env = wrappers.AddRenderObservation(env, render_only=False)
    observation, _ = env.reset(seed=0)
    assert observation["pixels"].shape == (4, 6, 3)
    ends = [env.step(np.zeros(12))[2:] for _ in range(3)]
    assert [truncated for _, truncated, _ in ends] == [False, False, True]
    assert ends[-1][2]["episode"]["l"] == 3


def test_a_video_is_recorded(camera, tmp_path):
    pytest.importorskip("moviepy", reason="RecordVideo needs moviepy")
    env = gymnasium.make(ID, max_episode_steps=3, render_mode="rgb_array")
    with wrappers.RecordVideo(env, str(tmp_path / "video")) as recorded:
        recorded.reset(seed=0)
        for _ in range(3):
            recorded.step(np.zeros(12))
    assert [path.suffix for path in (tmp_path / "video").iterdir()] == [".mp4"]


def test_closing_twice_is_closing_once(camera):
    env = LocomotionEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.render()
    env.close()
    env.close()


def playing(**changes):
    quiet = {
        "joint_scale": (1.0, 1.0),
        "base_velocity": 0.0,
        "friction": (1.0, 1.0),
        "push_speed": 0.0,
        "observation_noise": 0.0,
    }
    return LocomotionEnv(randomization=Randomization(**{**quiet, **changes}))


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
