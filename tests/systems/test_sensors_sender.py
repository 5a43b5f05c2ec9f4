"""What is sent of what the robot senses."""

import numpy as np
import pytest

from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import load_robot
from glassgait.models.task.observation import JOINT_NOISE
from glassgait.systems.sensors_sender import SensorsSender

A1 = load_robot()


def test_sends_joints_and_contacts_of_an_instant(fix_inputs, random_states):
    system = SensorsSender(A1, session=3)
    (state,) = random_states(1)
    state[quadruped.POSITION] = [0.0, 0.0, 0.3]
    context = fix_inputs(system, state=state, followed=1)
    context.SetTime(0.06)
    message = system.get_message_output_port().Eval(context)
    assert (message.session, message.sequence, message.utime) == (3, 3, 60_000)
    assert message.followed
    np.testing.assert_array_equal(message.joint_position, state[quadruped.JOINT_POSITION])
    np.testing.assert_array_equal(message.joint_velocity, state[quadruped.JOINT_VELOCITY])
    clone = context.Clone()
    fix_inputs(system, clone, followed=0)
    assert not system.get_message_output_port().Eval(clone).followed
    assert system.get_message_output_port().Eval(context).followed


def test_distinguishes_feet_on_the_ground_and_in_the_air(fix_inputs, standing):
    system = SensorsSender(A1, session=3)
    for lift, touches in ((-0.012, True), (0.05, False)):
        state = standing.copy()
        state[6] += lift
        context = fix_inputs(system, state=state, followed=0)
        assert system.get_message_output_port().Eval(context).foot_contact == 4 * [touches]


def test_adds_the_sensors_noise(fix_inputs, standing):
    system = SensorsSender(A1, session=3, noise_factor=0.5)
    context = fix_inputs(system, state=standing, followed=0, uniform_noise=np.ones(24))
    message = system.get_message_output_port().Eval(context)
    measured = np.concatenate([message.joint_position, message.joint_velocity])
    true = np.concatenate([standing[quadruped.JOINT_POSITION], standing[quadruped.JOINT_VELOCITY]])
    np.testing.assert_allclose(measured - true, 0.5 * JOINT_NOISE, atol=1e-15)


def test_refuses_noise_below_zero():
    with pytest.raises(ValueError, match="noise_factor"):
        SensorsSender(A1, session=3, noise_factor=-1.0)
