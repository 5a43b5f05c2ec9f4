"""What is sent of what the robot senses."""

import numpy as np

from glassgait.models.link.packing import unpack_imu
from glassgait.systems.sensors_sender import SensorsSender


def test_sends_what_was_measured_at_an_instant(fix_inputs, generator):
    system = SensorsSender(session=3)
    joints, imu = generator.normal(size=24), generator.normal(size=9)
    context = fix_inputs(system, joints=joints, touching=[1, 0, 0, 1], imu=imu, followed=1)
    context.SetTime(0.06)
    message = system.get_message_output_port().Eval(context)
    assert (message.session, message.sequence, message.utime) == (3, 3, 60_000)
    assert message.followed
    np.testing.assert_array_equal(message.joint_position, joints[:12])
    np.testing.assert_array_equal(message.joint_velocity, joints[12:])
    assert message.foot_contact == [True, False, False, True]
    np.testing.assert_array_equal(message.angular_velocity, imu[:3])
    np.testing.assert_array_equal(message.gravity, imu[6:])
    np.testing.assert_array_equal(unpack_imu(message), imu)
    clone = context.Clone()
    fix_inputs(system, clone, followed=0)
    assert not system.get_message_output_port().Eval(clone).followed
    assert system.get_message_output_port().Eval(context).followed
