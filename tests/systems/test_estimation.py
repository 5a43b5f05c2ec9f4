"""The estimators' systems; `tests/models/test_odometry.py` has what odometry computes."""

import numpy as np

from glassgait.models import GRAVITY
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.estimation import OdometrySystem, StateEstimator

A1 = load_robot()
STANDING = np.concatenate([A1.default_stance, np.zeros(12)])
AT_REST = np.array([0, 0, 0, 0, 0, CONTROL_PERIOD * GRAVITY, 0, 0, -1.0])


def test_odometry_begins_at_rest_and_goes_on_as_the_model(generator, fix_inputs, latch):
    odometry = Odometry(gain=0.3)
    system = OdometrySystem(A1, odometry)
    names = ("body_state", "previous_foot_height", "expected_foot_height")
    ports = [system.GetOutputPort(name) for name in names]
    context, state, heights = system.CreateDefaultContext(), None, np.zeros(4)
    for _ in range(6):
        joints = STANDING + 0.1 * generator.normal(size=24)
        imu = AT_REST + 0.1 * generator.normal(size=9)
        touching = generator.integers(0, 2, size=4)
        fix_inputs(system, context, joints=joints, imu=imu, touching=touching)
        position, velocity = np.split(joints, 2)
        if state is None:
            ahead, state = np.zeros(4), odometry.begin(A1, position)
        else:
            ahead = odometry.expected_heights(A1, state, position)
            state = odometry.advance(
                A1,
                state,
                joint_position=position,
                joint_velocity=velocity,
                imu=imu,
                touching=touching > 0,
            )
        body = odometry.body_state(A1, state, position)
        for port, expected in zip(ports, (body, heights, ahead), strict=True):
            np.testing.assert_array_equal(port.Eval(context), expected)
        heights = body[-4:]
        latch(system, context)


def test_a_context_that_begins_anew_expects_nothing(fix_inputs, latch):
    system = OdometrySystem(A1, Odometry())
    inputs = {"joints": STANDING, "imu": AT_REST, "touching": np.zeros(4)}
    context = fix_inputs(system, **inputs)
    latch(system, context)
    fix_inputs(system, context, joints=STANDING + 0.1)
    port = system.GetOutputPort("expected_foot_height")
    assert port.Eval(context).any()
    system.SetDefaultContext(context)
    assert not port.Eval(context).any()


def test_a_learned_estimator_remembers_the_foot_heights_of_the_instant_before(fix_inputs, latch):
    system = StateEstimator(lambda observed: 2.0 * observed[:7], 42)
    context = fix_inputs(system, proprioception=np.arange(42.0))
    clone = context.Clone()
    np.testing.assert_array_equal(
        system.GetOutputPort("body_state").Eval(context), 2.0 * np.arange(7.0)
    )
    port = system.GetOutputPort("previous_foot_height")
    assert port.Eval(context).tolist() == [0, 0, 0, 0]
    latch(system, context)
    assert port.Eval(context).tolist() == [6, 8, 10, 12]
    assert port.Eval(clone).tolist() == [0, 0, 0, 0]
