"""The observation: names, order, scales."""

import numpy as np
import pytest

from glassgait.models.a1 import robot
from glassgait.models.task.observation import (
    ObservationLayout,
    body_state,
    machine_state_entries,
    proprioception,
)


@pytest.mark.parametrize(("n_states", "size"), [(2, 49), (4, 51), (5, 52)])
def test_sizes(n_states, size):
    layout = ObservationLayout(n_states)
    assert layout.size == len(set(layout.names)) == size
    assert layout.n_proprioceptive == size - 7


def test_names_follow_the_papers_tables():
    names = ObservationLayout(2).names
    expected = ("Prev Action FL Hip", "RM State 0", "RM Iters", "Foot Height FL", "Base Lin Vel Z")
    assert set(expected) <= set(names)
    assert names[0] == "Command X"


def test_every_entry_stands_under_its_name():
    joints = np.arange(12.0)
    values = proprioception(
        command=np.array([0.5, -0.25]),
        joint_position=robot.DEFAULT_STANCE + joints,
        joint_velocity=20.0 * joints,
        previous_action=-joints,
        rm_state=np.array([0.0, 1.0]),
        rm_iterations=np.array(7),
        commanded_dwell=np.array(9),
    )
    layout = ObservationLayout(2)
    named = dict(zip(layout.names, values, strict=False))
    assert len(values) == layout.n_proprioceptive
    assert named["Command X"] == 0.5
    assert named["Command Yaw"] == -0.25
    assert named["DoF Pos FR Thigh"] == pytest.approx(4.0)
    assert named["DoF Vel RR Calf"] == pytest.approx(11.0)
    assert named["Prev Action RL Hip"] == -6.0
    assert (named["RM State 0"], named["RM State 1"]) == (0.0, 1.0)
    assert named["RM Iters"] == pytest.approx(0.7)
    assert named["Command RM Iters"] == pytest.approx(0.9)
    np.testing.assert_array_equal(values[machine_state_entries(layout.names)], [0.0, 1.0])


def test_noise_is_in_radians_before_the_scales():
    noise = np.concatenate([np.full(12, 0.01), np.full(12, 1.5)])
    still = (np.zeros(2), np.zeros(12), np.zeros(12), np.zeros(12), np.zeros(2))
    counts = (np.array(0.0), np.array(8.0))
    quiet = proprioception(*still, *counts)
    noisy = proprioception(*still, *counts, joint_noise=noise)
    np.testing.assert_allclose((noisy - quiet)[2:14], 0.01)
    np.testing.assert_allclose((noisy - quiet)[14:26], 0.075)


def test_body_state_is_scaled_velocity_and_foot_heights(standing):
    state = standing.copy()
    state[robot.LINEAR_VELOCITY] = [0.5, 0.0, -0.1]
    np.testing.assert_allclose(body_state(state)[:3], [1.0, 0.0, -0.2])
    np.testing.assert_allclose(body_state(state)[3:].min(), 0.0, atol=1e-12)
