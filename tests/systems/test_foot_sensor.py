"""The foot sensor."""

import numpy as np

from glassgait.models.robots.library import load_robot
from glassgait.systems.foot_sensor import FootSensor

A1 = load_robot()


def sensed(system, context):
    return (
        system.get_foot_contact_output_port().Eval(context),
        system.get_foot_height_output_port().Eval(context),
    )


def test_senses_contact_and_height(standing, fix_inputs):
    system = FootSensor(A1)
    standing[6] += 0.05
    contact, height = sensed(system, fix_inputs(system, state=standing))
    np.testing.assert_array_equal(contact, 0)
    np.testing.assert_allclose(height.min(), 0.05)


def test_touching_is_of_this_instant_alone(standing, fix_inputs, latch):
    system = FootSensor(A1)
    lifted = standing.copy()
    standing[6] -= 0.012
    lifted[6] += 0.05
    context = fix_inputs(system, state=standing)
    port = system.get_touching_output_port()
    np.testing.assert_array_equal(port.Eval(context), 1)
    latch(system, context)
    fix_inputs(system, context, state=lifted)
    np.testing.assert_array_equal(port.Eval(context), 0)


def test_contact_outlasts_the_touch_by_one_control_step(standing, fix_inputs, latch):
    system = FootSensor(A1)
    lifted = standing.copy()
    standing[6] -= 0.012
    lifted[6] += 0.05
    context = fix_inputs(system, state=standing)
    latch(system, context)
    fix_inputs(system, context, state=lifted)
    np.testing.assert_array_equal(sensed(system, context)[0], 1)
    latch(system, context)
    np.testing.assert_array_equal(sensed(system, context)[0], 0)


def test_clones_keep_their_own_memory(standing, fix_inputs, latch):
    system = FootSensor(A1)
    standing[6] -= 0.012
    context = fix_inputs(system, state=standing)
    clone = context.Clone()
    latch(system, context)
    lifted = standing.copy()
    lifted[6] += 0.5
    fix_inputs(system, context, state=lifted)
    fix_inputs(system, clone, state=lifted)
    np.testing.assert_array_equal(sensed(system, context)[0], 1)
    np.testing.assert_array_equal(sensed(system, clone)[0], 0)
