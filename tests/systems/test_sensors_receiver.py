"""What a controller reads of what the robot senses."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

from glassgait.models.link.messages import sensors_t, targets_t
from glassgait.models.link.packing import pack_sensors
from glassgait.systems.sensors_receiver import SensorsReceiver


def test_gives_joints_feet_and_imu(generator):
    system = SensorsReceiver()
    context = system.CreateDefaultContext()
    joints, imu = generator.normal(size=24), generator.normal(size=9)
    touching = np.array([True, False, False, True])
    packed = pack_sensors(3, 0.02, joints=joints, touching=touching, imu=imu, followed=True)
    message = sensors_t.decode(packed.encode())
    system.get_message_input_port().FixValue(context, AbstractValue.Make(message))
    clone = context.Clone()
    np.testing.assert_array_equal(system.get_joints_output_port().Eval(context), joints)
    np.testing.assert_array_equal(system.get_imu_output_port().Eval(context), imu)
    np.testing.assert_array_equal(system.get_touching_output_port().Eval(clone), [1, 0, 0, 1])


def test_before_the_first_message_no_foot_touches():
    system = SensorsReceiver()
    context = system.CreateDefaultContext()
    system.get_message_input_port().FixValue(context, AbstractValue.Make(sensors_t()))
    np.testing.assert_array_equal(system.get_touching_output_port().Eval(context), 0)


def test_a_message_of_another_kind_is_refused():
    system = SensorsReceiver()
    context = system.CreateDefaultContext()
    system.get_message_input_port().FixValue(context, AbstractValue.Make(targets_t()))
    with pytest.raises(AttributeError):
        system.get_joints_output_port().Eval(context)
