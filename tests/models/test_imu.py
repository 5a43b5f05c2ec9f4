"""The measurements of an IMU."""

import numpy as np

from glassgait.models import GRAVITY
from glassgait.models.estimation.sensors import ImuReading, measure_imu
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.task import CONTROL_PERIOD

DOWN = np.array([0.0, 0.0, -GRAVITY])


def test_at_rest_it_feels_the_ground_push_and_nothing_turn(standing):
    for state in (standing, np.tile(standing, (3, 2, 1))):
        reading = measure_imu(state, state[..., quadruped.LINEAR_VELOCITY], DOWN)
        assert reading.shape == (*state.shape[:-1], 9)
        parts = ImuReading.of(reading)
        np.testing.assert_allclose(parts.angular_velocity, 0.0)
        up = np.broadcast_to([0.0, 0.0, CONTROL_PERIOD * GRAVITY], parts.velocity_change.shape)
        np.testing.assert_allclose(parts.velocity_change, up, atol=1e-15)
        np.testing.assert_allclose(parts.gravity, np.sign(-up), atol=1e-15)


def test_everything_is_in_the_trunks_frame(random_states):
    state = random_states(20)
    before = np.zeros((20, 3))
    parts = ImuReading.of(measure_imu(state, before, DOWN))
    to_world = kinematics.rotation_matrix(state[:, quadruped.QUATERNION])
    for own, world in (
        (parts.angular_velocity, state[:, quadruped.ANGULAR_VELOCITY]),
        (parts.velocity_change, state[:, quadruped.LINEAR_VELOCITY] - CONTROL_PERIOD * DOWN),
        (parts.gravity, np.tile([0.0, 0.0, -1.0], (20, 1))),
    ):
        np.testing.assert_allclose(np.einsum("nij,nj->ni", to_world, own), world, atol=1e-12)
    expected = kinematics.gravity_direction(state[:, quadruped.QUATERNION])
    np.testing.assert_allclose(parts.gravity, expected, atol=1e-12)


def test_each_robot_feels_the_gravity_of_where_it_stands(standing):
    lean = GRAVITY * np.array([[-np.sin(0.2), 0.0, -np.cos(0.2)], [0.0, 0.0, -1.0]])
    state = np.tile(standing, (2, 1))
    parts = ImuReading.of(measure_imu(state, np.zeros((2, 3)), lean))
    np.testing.assert_allclose(parts.gravity, lean / GRAVITY, atol=1e-12)
