"""What is sent of joint targets."""

import numpy as np
from pydrake.common.value import AbstractValue

from glassgait.models.link.messages import sensors_t
from glassgait.models.robots.library import load_robot
from glassgait.models.task.request import NO_MODE
from glassgait.systems.targets_sender import TargetsSender

A1 = load_robot()


def sensors(sequence):
    message = sensors_t()
    message.session, message.sequence, message.utime = 3, sequence, 20_000 * sequence
    return AbstractValue.Make(message)


def test_answers_the_sensors(fix_inputs, generator):
    system, action = TargetsSender(A1, day="d1"), generator.normal(size=12, scale=5.0)
    context = fix_inputs(system, action=action)
    system.get_sensors_input_port().FixValue(context, sensors(5))
    clone = context.Clone()
    system.get_sensors_input_port().FixValue(clone, sensors(6))
    message = system.get_message_output_port().Eval(context)
    assert (message.session, message.sequence, message.utime) == (3, 5, 100_000)
    np.testing.assert_array_equal(message.joint_position, A1.joint_targets(action, limited=True))
    assert system.get_message_output_port().Eval(clone).sequence == 6
    assert not message.damped
    assert (message.mode, message.day) == (NO_MODE, "d1")
    fix_inputs(system, clone, damped=1.0, mode=4.0)
    assert system.get_message_output_port().Eval(clone).mode == 4
    assert system.get_message_output_port().Eval(clone).damped
    assert not system.get_message_output_port().Eval(context).damped
