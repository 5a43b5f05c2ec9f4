"""What a controller reads of what the robot senses."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

from glassgait.models.export.binding import Sensors
from glassgait.models.link.messages import sensors_t, targets_t
from glassgait.models.link.packing import pack_sensors
from glassgait.models.robots import quadruped
from glassgait.systems.sensors_receiver import SensorsReceiver


def test_gives_joints_and_feet_and_no_trunk(generator):
    system = SensorsReceiver()
    context = system.CreateDefaultContext()
    sent = Sensors(
        generator.normal(size=12), generator.normal(size=12), np.array([True, False, False, True])
    )
    message = sensors_t.decode(pack_sensors(3, 0.02, sent, followed=True).encode())
    system.get_message_input_port().FixValue(context, AbstractValue.Make(message))
    clone = context.Clone()
    state = system.get_state_output_port().Eval(context)
    np.testing.assert_array_equal(state[quadruped.JOINT_POSITION], sent.joint_position)
    np.testing.assert_array_equal(state[quadruped.JOINT_VELOCITY], sent.joint_velocity)
    for trunk in (
        quadruped.QUATERNION,
        quadruped.POSITION,
        quadruped.ANGULAR_VELOCITY,
        quadruped.LINEAR_VELOCITY,
    ):
        assert np.all(np.isnan(state[trunk]))
    np.testing.assert_array_equal(system.get_touching_output_port().Eval(clone), [1, 0, 0, 1])


def test_before_the_first_message_no_foot_touches():
    system = SensorsReceiver()
    context = system.CreateDefaultContext()
    system.get_message_input_port().FixValue(context, AbstractValue.Make(sensors_t()))
    np.testing.assert_array_equal(system.get_touching_output_port().Eval(context), 0)


def test_a_message_of_another_kind_is_no_state():
    system = SensorsReceiver()
    context = system.CreateDefaultContext()
    system.get_message_input_port().FixValue(context, AbstractValue.Make(targets_t()))
    with pytest.raises(AttributeError):
        system.get_state_output_port().Eval(context)
