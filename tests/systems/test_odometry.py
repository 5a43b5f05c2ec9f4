"""The odometry's system; `tests/models/test_odometry.py` has what it computes."""

import numpy as np

from glassgait.models.estimation.imu import GRAVITY
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.odometry import OdometrySystem

A1 = load_robot()
STANDING = np.concatenate([A1.default_stance, np.zeros(12)])
AT_REST = np.array([0, 0, 0, 0, 0, CONTROL_PERIOD * GRAVITY, 0, 0, -1.0])


def inputs(generator):
    return {
        "joints": STANDING + 0.1 * generator.normal(size=24),
        "imu": AT_REST + 0.1 * generator.normal(size=9),
        "touching": generator.integers(0, 2, size=4),
    }


def estimated(system, context):
    return system.get_body_state_output_port().Eval(context)


def previous_heights(system, context):
    return system.get_previous_foot_height_output_port().Eval(context)


def expected_heights(system, context):
    return system.get_expected_foot_height_output_port().Eval(context)


def test_it_begins_at_rest_and_goes_on_as_the_model(generator, fix_inputs, latch):
    odometry = Odometry(gain=0.3)
    system = OdometrySystem(A1, odometry)
    context, state, heights = system.CreateDefaultContext(), None, np.zeros(4)
    for _ in range(6):
        now = inputs(generator)
        fix_inputs(system, context, **now)
        position, velocity = np.split(now["joints"], 2)
        if state is None:
            ahead, state = np.zeros(4), odometry.begin(A1, position)
        else:
            ahead = odometry.expected_heights(A1, state, position)
            state = odometry.advance(
                A1,
                state,
                joint_position=position,
                joint_velocity=velocity,
                imu=now["imu"],
                touching=now["touching"] > 0,
            )
        expected = odometry.body_state(A1, state, position)
        np.testing.assert_allclose(estimated(system, context), expected, atol=1e-12)
        np.testing.assert_allclose(previous_heights(system, context), heights, atol=1e-12)
        np.testing.assert_allclose(expected_heights(system, context), ahead, atol=1e-12)
        heights = expected[-4:]
        latch(system, context)


def test_a_reading_counts_once_however_often_it_is_looked_at(generator, fix_inputs):
    system = OdometrySystem(A1, Odometry())
    context = fix_inputs(system, **inputs(generator))
    first = estimated(system, context).copy()
    fix_inputs(system, context, **inputs(generator))
    estimated(system, context)
    fix_inputs(system, context, **inputs(np.random.default_rng(7)))
    np.testing.assert_array_equal(estimated(system, context), first)


def test_clones_keep_their_own_memory(generator, fix_inputs, latch):
    system = OdometrySystem(A1, Odometry())
    context = fix_inputs(system, joints=STANDING, imu=AT_REST, touching=np.zeros(4))
    clone = context.Clone()
    latch(system, context)
    pushed = AT_REST + np.eye(9)[3]
    for own in (context, clone):
        fix_inputs(system, own, imu=pushed)
    np.testing.assert_allclose(estimated(system, context)[:3], [2.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_array_equal(estimated(system, clone)[:3], 0.0)


def test_feet_that_have_just_come_down_do_not_correct(fix_inputs, latch):
    system = OdometrySystem(A1, Odometry(gain=1.0))
    context = fix_inputs(system, joints=STANDING, imu=AT_REST, touching=np.zeros(4))
    latch(system, context)
    swept = STANDING.copy()
    swept[12:] = 1.0
    fix_inputs(system, context, joints=swept, touching=np.ones(4))
    np.testing.assert_allclose(estimated(system, context)[:3], 0.0, atol=1e-12)
    latch(system, context)
    assert np.any(np.abs(estimated(system, context)[:3]) > 0.01)
