"""Batch physics: groups, threads, latencies, and robots that cannot be advanced."""

import numpy as np
import pytest

from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.station import StationConfig
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.terrain import PLANE, Terrain

A1 = load_robot()


def drake(*groups, n_threads=1):
    return make_physics(A1, *groups or (StationConfig(),), n_threads=n_threads)


def mujoco(*groups):
    station = StationConfig(time_step=0.002, engine="mujoco")
    return make_physics(A1, *[station for _ in groups or (None,)])


@pytest.fixture(scope="module", params=[1, 2, "mujoco"])
def physics(request):
    return mujoco() if request.param == "mujoco" else drake(n_threads=request.param)


def standing_batch(count):
    states = kinematics.standing_state(A1, np.tile(A1.default_stance, (count, 1)))
    return states, np.tile(A1.default_stance, (count, 1))


def test_robots_stand(physics):
    states, targets = standing_batch(3)
    for _ in range(50):
        step = physics.step(states, targets)
        states = step.states
    assert np.all(states[:, 6] > 0.24)
    assert step.touching.all()
    np.testing.assert_array_equal(states[0], states[2])


@pytest.mark.parametrize("where", ["state", "target"])
def test_one_robots_nan_never_spoils_another(physics, where):
    states, targets = standing_batch(4)
    states[:, 19] = [0.1, 0.2, 0.3, 0.4]
    alone = physics.step(states, targets).states
    (states if where == "state" else targets)[1, 8] = np.nan
    after = physics.step(states, targets).states
    assert np.isnan(after[1]).all()
    np.testing.assert_array_equal(after[[0, 2, 3]], alone[[0, 2, 3]])


@pytest.mark.parametrize("n_threads", [1, 2])
@pytest.mark.parametrize("terrain", [PLANE, Terrain("blocks", amplitude=0.01)])
def test_a_robot_that_the_solver_cannot_advance_is_lost_alone(n_threads, terrain):
    station = StationConfig(terrain=terrain)
    physics = drake(station, n_threads=n_threads)
    states, targets = standing_batch(5)
    alone = physics.step(states, targets).states
    states[3, 19:] = 1e200
    after = physics.step(states, targets).states
    assert not np.isfinite(after[3]).all()
    np.testing.assert_array_equal(after[[0, 1, 2, 4]], alone[[0, 1, 2, 4]])
    # And what comes next is as if nothing had been.
    later, fresh = (own.step(alone, targets).states for own in (physics, drake(station)))
    np.testing.assert_array_equal(later, fresh)


def test_drakes_threads_and_pythons_loop_agree_in_every_bit():
    loop, threads = (make_physics(A1, StationConfig(), n_threads=count) for count in (1, 2))
    states, targets = standing_batch(7)
    ends = []
    for physics in (loop, threads):
        physics.set_friction(np.array([0.4]))
        moved, noise = states, np.random.default_rng(5)
        for _ in range(20):
            moved = physics.step(moved, targets + 0.4 * noise.normal(size=(7, 12))).states
        ends.append(moved)
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize("engine", [drake, mujoco])
def test_slippery_groups_slide_further(engine):
    physics = engine(StationConfig(), StationConfig())
    physics.set_friction(np.array([0.05, 1.0]))
    states, targets = standing_batch(4)
    states[:, quadruped.LINEAR_VELOCITY] = [1.0, 0.0, 0.0]
    for _ in range(15):
        states = physics.step(states, targets).states
    slid = states[:, 4]
    assert slid[0] == slid[1]
    assert slid[2] == slid[3]
    assert slid[0] > slid[2] + 0.05
