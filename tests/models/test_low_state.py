"""What a robot senses, through LowState and back."""

from types import SimpleNamespace

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.link.low_state import (
    Gathered,
    foot_force_of,
    gravity_of,
    is_finite,
    joints_of,
    pack_state,
    roll_pitch_yaw,
    sensors_of,
    touching_of,
)
from glassgait.models.link.unitree_messages import LOW_STATE, is_sound
from glassgait.models.robots.foot_force import FootForce
from glassgait.models.robots.library import load_robot

GO2 = load_robot("go2")

SENSED = {
    "joints": np.arange(24.0) / 10.0,
    "torque": np.arange(12.0),
    "quaternion": np.array([1.0, 0.0, 0.0, 0.0]),
    "angular_velocity": np.array([0.1, 0.2, 0.3]),
    "specific_force": np.array([0.0, 0.5, 9.81]),
    "foot_force": np.array([1.0, 2.0, 3.0, 4.0]),
    "remote": bytes(40),
}


def state(tick=0, **changes):
    return pack_state(GO2, tick, **(SENSED | changes))


def test_a_state_has_joints_and_feet_where_robots_have_them():
    message = state(42)
    assert is_sound(message)
    assert is_finite(message)
    assert message["tick"] == 42
    # Motor 0 is the front right hip, 3 the front left one.
    motors = message["motor_state"]
    np.testing.assert_allclose(motors["q"][[0, 3, 6, 9]], [0.3, 0.0, 0.9, 0.6], atol=1e-7)
    np.testing.assert_allclose(motors["tau_est"][:12].reshape(4, 3)[:, 0], [3, 0, 9, 6])
    assert not motors["q"][12:].any()
    assert message["foot_force"].tolist() == [8, 4, 16, 12]
    np.testing.assert_allclose(joints_of(GO2, message), SENSED["joints"], atol=1e-6)


def test_forces_beyond_what_counts_hold_are_the_greatest():
    assert state(foot_force=np.full(4, 1e6))["foot_force"].tolist() == [32767] * 4


@pytest.mark.parametrize(
    ("quaternion", "gravity"),
    [
        ([1, 0, 0, 0], [0, 0, -1]),
        ([0, 1, 0, 0], [0, 0, 1]),
        # A quarter turn about x: the left side is up.
        ([np.sqrt(0.5), np.sqrt(0.5), 0, 0], [0, -1, 0]),
        # About y: the nose is down.
        ([np.sqrt(0.5), 0, np.sqrt(0.5), 0], [1, 0, 0]),
        # About z nothing changes; neither by a sign or a length.
        ([np.sqrt(0.5), 0, 0, np.sqrt(0.5)], [0, 0, -1]),
        ([-1.1, 0, 0, 0], [0, 0, -1]),
    ],
)
def test_gravity_points_down_in_the_trunks_frame(quaternion, gravity):
    message = LOW_STATE.blank()
    message["imu_state"]["quaternion"] = quaternion
    np.testing.assert_allclose(gravity_of(message), gravity, atol=1e-7)


def test_roll_pitch_and_yaw_are_those_of_the_attitude():
    turns = {"roll": [1, 0, 0], "pitch": [0, 1, 0], "yaw": [0, 0, 1]}
    for index, axis in enumerate(turns.values()):
        quaternion = np.array([np.cos(0.2), *(np.sin(0.2) * np.array(axis))])
        np.testing.assert_allclose(roll_pitch_yaw(2.0 * quaternion), 0.4 * np.eye(3)[index])


def test_a_foot_touches_from_one_force_on_and_until_a_lower_one():
    limits = foot_force_of(GO2)
    touching, seen = np.zeros(4, dtype=bool), []
    for counts in (0, limits.touch - 1, limits.touch, limits.release + 1, limits.release, 50):
        message = LOW_STATE.blank()
        # The front right foot, second of ours.
        message["foot_force"][0] = counts
        touching = touching_of(GO2, message, touching)
        seen.append(bool(touching[1]))
        assert not touching[[0, 2, 3]].any()
    assert seen == [False, False, True, True, False, False]


def test_thresholds_in_the_wrong_order_are_refused():
    with pytest.raises(InputError, match="release is 60"):
        FootForce(release=60.0, touch=60.0, per_newton=1.0)


def test_a_robot_whose_file_says_nothing_of_forces_is_refused():
    with pytest.raises(InputError, match=r"mine\.yaml: lacks foot_force"):
        foot_force_of(SimpleNamespace(foot_force=None, path="mine.yaml"))


def test_the_force_of_a_control_period_is_summed():
    gathered = Gathered.begin()
    for tick in range(1000, 1020, 2):
        gathered = gathered.after(GO2, state(tick))
    np.testing.assert_allclose(gathered.velocity_change, [0.0, 0.01, 0.1962], atol=1e-7)
    assert not gathered.at_control_instant().velocity_change.any()
    assert gathered.at_control_instant().tick == 1018


def test_a_state_that_was_lost_is_made_up_for():
    gathered = Gathered.begin()
    for tick in (0, 2, 8, 10):
        gathered = gathered.after(GO2, state(tick))
    np.testing.assert_allclose(gathered.velocity_change[2], 6 * 0.002 * 9.81, rtol=1e-6)


def test_a_controller_is_asked_in_its_own_order():
    gathered = Gathered.begin().after(GO2, state(8, foot_force=np.array([20.0, 0.0, 0.0, 0.0])))
    sensors = sensors_of(GO2, state(8), gathered, 3, followed=True)
    np.testing.assert_allclose(sensors.joint_position, np.arange(12) / 10.0, atol=1e-7)
    np.testing.assert_allclose(sensors.joint_velocity, np.arange(12, 24) / 10.0, atol=1e-6)
    assert sensors.foot_contact == [True, False, False, False]
    np.testing.assert_allclose(sensors.angular_velocity, [0.1, 0.2, 0.3], atol=1e-7)
    assert sensors.gravity == [0.0, 0.0, -1.0]
    assert (sensors.sequence, sensors.utime, sensors.followed) == (3, 60_000, True)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e20])
@pytest.mark.parametrize(
    ("part", "field"),
    [
        ("imu_state", "quaternion"),
        ("imu_state", "gyroscope"),
        ("imu_state", "accelerometer"),
        ("motor_state", "q"),
        ("motor_state", "dq"),
    ],
)
def test_what_is_read_must_be_finite(part, field, value):
    message = state()
    message[part][field][2] = value
    assert not is_finite(message)


def test_an_attitude_of_zeros_is_none():
    message = state()
    message["imu_state"]["quaternion"] = 0.0
    assert not is_finite(message)
