"""The memory of contacts."""

import numpy as np

from glassgait.models.robots.robot import load_robot
from glassgait.systems.contact_memory import ContactMemory
from glassgait.systems.foot_sensor import FootSensor

A1 = load_robot()


def test_contact_outlasts_the_touch_by_one_control_step(fix_inputs, latch):
    system = ContactMemory()
    port = system.get_foot_contact_output_port()
    context = fix_inputs(system, touching=[1, 0, 0, 1])
    np.testing.assert_array_equal(port.Eval(context), [1, 0, 0, 1])
    latch(system, context)
    fix_inputs(system, context, touching=[0, 1, 0, 0])
    clone = context.Clone()
    np.testing.assert_array_equal(port.Eval(context), [1, 1, 0, 1])
    latch(system, context)
    np.testing.assert_array_equal(port.Eval(context), [0, 1, 0, 0])
    np.testing.assert_array_equal(port.Eval(clone), [1, 1, 0, 1])


def test_equals_the_foot_sensors_contact(fix_inputs, latch, standing):
    memory, sensor = ContactMemory(), FootSensor(A1)
    contexts = [memory.CreateDefaultContext(), sensor.CreateDefaultContext()]
    for lift in (-0.012, 0.05, 0.05, -0.012):
        state = standing.copy()
        state[6] += lift
        fix_inputs(memory, contexts[0], touching=[float(lift < 0)] * 4)
        fix_inputs(sensor, contexts[1], state=state)
        message = [
            system.get_foot_contact_output_port().Eval(context)
            for system, context in zip((memory, sensor), contexts, strict=True)
        ]
        np.testing.assert_array_equal(*message)
        latch(memory, contexts[0])
        latch(sensor, contexts[1])
