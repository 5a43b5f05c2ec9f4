"""Leg odometry."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models import GRAVITY
from glassgait.models.arrays import cross
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.estimation.sensors import measure_imu
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.observation import REFLECT_JOINTS, ObservationLayout, reflect_observation

A1 = load_robot()
DOWN = np.array([0.0, 0.0, -GRAVITY])
ALL = np.ones(4, dtype=bool)
AT_REST = np.array([0, 0, 0, 0, 0, CONTROL_PERIOD * GRAVITY, 0, 0, -1.0])

small = st.floats(-0.15, 0.15)
joints = st.lists(small, min_size=12, max_size=12).map(lambda own: A1.default_stance + own)


def run(odometry, steps, begin):
    """Advances odometry from a stance, with the named inputs of each step."""
    state = odometry.begin(A1, begin)
    for own in steps:
        state = odometry.advance(A1, state, **own)
    return state


def measured(**changes):
    own = {"joint_position": A1.default_stance, "joint_velocity": np.zeros(12)}
    return own | {"imu": AT_REST, "touching": ALL} | changes


def test_a_robot_that_stands_stays_where_it_is():
    state = run(Odometry(), [measured()] * 50, A1.default_stance)
    body = Odometry().body_state(A1, state, A1.default_stance)
    np.testing.assert_allclose(body, 0.0, atol=1e-12)


@given(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5))
def test_a_turning_trunk_sees_a_steady_velocity_turn(rate, speed):
    count = 10
    steps = []
    for step in range(count + 1):
        plant = kinematics.standing_state(A1)
        angle = rate * step * CONTROL_PERIOD
        plant[quadruped.QUATERNION] = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        plant[quadruped.ANGULAR_VELOCITY] = [0.0, 0.0, rate]
        plant[quadruped.LINEAR_VELOCITY] = [speed, 0.0, 0.0]
        before = plant[quadruped.LINEAR_VELOCITY] * (step > 0)
        steps.append(measured(imu=measure_imu(plant, before, DOWN), touching=~ALL))
    state = run(Odometry(), steps, A1.default_stance)
    true, _ = kinematics.base_velocity(plant)
    # Each step follows a chord instead of an arc.
    most = 1e-12 + count * abs(speed) * (rate * CONTROL_PERIOD) ** 2
    np.testing.assert_allclose(state.velocity, true, atol=most)


@given(joints, st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6))
def test_standing_feet_give_the_velocity_of_a_trunk_that_moves_over_them(pose, twist):
    """With a gain of 1, velocity follows from joints that keep the feet's lowest points at rest."""
    velocity, turning = np.array(twist[:3]), np.array(twist[3:])
    down = np.array([0.0, 0.0, -A1.foot_radius])
    lowest = kinematics.foot_positions(A1, pose) + down
    swept = -(velocity + cross(turning, lowest))
    rates = np.zeros(12)
    for leg in range(4):
        own = slice(3 * leg, 3 * leg + 3)
        motions = [kinematics.foot_motion(A1, pose, np.eye(12)[i]) for i in range(12)[own]]
        columns = [own.velocity[leg] + np.cross(own.turning[leg], down) for own in motions]
        rates[own] = np.linalg.solve(np.transpose(columns), swept[leg])
    imu = np.concatenate([turning, AT_REST[3:]])
    step = measured(joint_position=pose, joint_velocity=rates, imu=imu)
    state = run(Odometry(gain=1.0), [step, step], pose)
    np.testing.assert_allclose(state.velocity, velocity, atol=1e-9)


@given(st.lists(small, min_size=24, max_size=24), st.lists(small, min_size=9, max_size=9))
def test_mirrored_inputs_give_mirrored_estimates(errors, imu_errors):
    """Joints are mirrored like actions; rotations and displacements have different signs."""
    position = A1.default_stance + errors[:12]
    velocity, imu = 10.0 * np.array(errors[12:]), AT_REST + imu_errors
    touching = np.array([True, False, True, True])
    step = measured(joint_position=position, joint_velocity=velocity, imu=imu, touching=touching)
    signs = np.array([-1, 1, -1, 1, -1, 1, 1, -1, 1.0])
    image = {
        "joint_position": A1.default_stance + REFLECT_JOINTS(position - A1.default_stance),
        "joint_velocity": REFLECT_JOINTS(velocity),
        "imu": signs * imu,
        "touching": touching[[1, 0, 3, 2]],
    }
    body, mirrored = (
        Odometry().body_state(A1, run(Odometry(), [own] * 5, begin), begin)
        for own, begin in ((step, position), (image, image["joint_position"]))
    )
    names = ObservationLayout(2).names
    _, reflect = reflect_observation(names, (1, 0)).split(len(names) - 7)
    np.testing.assert_allclose(mirrored, reflect(body), atol=1e-9)


@pytest.mark.parametrize("lean", [(0.2, 0.0), (0.0, -0.3), (-0.15, 0.25)])
def test_heights_are_above_the_plane_that_the_feet_stand_on(lean):
    """The legs stand on a slope, and then one foot is lifted."""
    slope_x, slope_y = lean
    normal = np.array([-slope_x, -slope_y, 1.0])
    normal /= np.linalg.norm(normal)
    pose = stance_on(slope_x, slope_y)
    state = run(Odometry(), [measured(joint_position=pose)] * 3, pose)
    body = Odometry().body_state(A1, state, pose)
    np.testing.assert_allclose(body[3:], 0.0, atol=1e-9)
    lifted = pose.copy()
    lifted[2] -= 0.4
    touching = np.array([False, True, True, True])
    step = measured(joint_position=lifted, touching=touching)
    state = Odometry().advance(A1, state, **step)
    moved = kinematics.foot_positions(A1, lifted) - kinematics.foot_positions(A1, pose)
    body = Odometry().body_state(A1, state, lifted)
    assert body[3] == pytest.approx(normal @ moved[0], abs=1e-6) and body[3] > 0.03
    np.testing.assert_allclose(body[4:], 0.0, atol=1e-6)


def stance_on(slope_x, slope_y):
    """Finds joint angles with all feet on a plane under the trunk, by Newton's method."""
    pose = A1.default_stance.copy()
    target = kinematics.foot_positions(A1, pose)
    target[:, 2] = target[:, 2].mean() + slope_x * target[:, 0] + slope_y * target[:, 1]
    for _ in range(30):
        off = target - kinematics.foot_positions(A1, pose)
        for leg in range(4):
            own = range(3 * leg, 3 * leg + 3)
            columns = [kinematics.foot_motion(A1, pose, np.eye(12)[i]).velocity[leg] for i in own]
            pose[list(own)] += np.linalg.solve(np.transpose(columns), off[leg])
    assert np.abs(target - kinematics.foot_positions(A1, pose)).max() < 1e-9
    return pose


def test_a_foot_that_swings_does_not_stand_though_its_sensor_reads_a_contact():
    rates = np.zeros(12)
    rates[1] = 10.0
    swinging = measured(joint_velocity=rates)
    state = run(Odometry(gain=1.0), [swinging] * 3, A1.default_stance)
    np.testing.assert_allclose(state.velocity, 0.0, atol=1e-12)
    # If all feet seem to swing, the trunk is fast.
    running = measured(joint_velocity=np.tile(rates[:3], 4))
    state = run(Odometry(gain=1.0), [running] * 3, A1.default_stance)
    assert state.velocity[0] > 2.0


@pytest.mark.parametrize(
    ("velocity", "turning", "rise"),
    [
        ((0.7, -0.2, 0.0), (0.0, 0.0, 2.0), np.zeros(4)),
        ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0), np.full(4, 0.01)),
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), np.array([1.0, -1.0, 1.0, -1.0])),
        ((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), np.array([-1.0, -1.0, 1.0, 1.0])),
    ],
    ids=["along the ground", "upward", "rolling to the right", "nose down"],
)
def test_heights_are_expected_as_the_trunk_was_moving(velocity, turning, rise):
    odometry = Odometry()
    before = odometry.begin(A1, A1.default_stance)._replace(
        velocity=np.array(velocity), turning=np.array(turning)
    )
    heights = odometry.expected_heights(A1, before, A1.default_stance)
    if np.any(turning[:2]):
        np.testing.assert_array_equal(np.sign(heights), rise)
    else:
        # The default stance leans by a degree, so motion along the ground is slightly upward.
        np.testing.assert_allclose(heights, rise, atol=5e-4)
