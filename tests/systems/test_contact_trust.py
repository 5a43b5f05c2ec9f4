"""Contact sensors that are believed, and those that are not."""

import numpy as np

from glassgait.models.estimation.contact import UNCHANGED_STEPS
from glassgait.systems.contact_trust import ContactTrustSystem

HEIGHT = [0.0, 0.05, 0.0, 0.05]


def test_stuck_sensors_give_way_to_heights_until_they_change(fix_inputs, latch):
    system = ContactTrustSystem()
    contact = system.get_believed_contact_output_port()
    touching = system.get_believed_touching_output_port()
    seen = {"touching": [1, 1, 0, 0], "foot_height": HEIGHT}
    context = fix_inputs(system, **seen)
    for _ in range(UNCHANGED_STEPS):
        np.testing.assert_array_equal(contact.Eval(context), seen["touching"])
        np.testing.assert_array_equal(touching.Eval(context), seen["touching"])
        latch(system, context)
    believed = [1, 0, 1, 0]
    np.testing.assert_array_equal(contact.Eval(context), believed)
    np.testing.assert_array_equal(touching.Eval(context), believed)
    clone = context.Clone()
    fix_inputs(system, context, **(seen | {"touching": [1, 0, 1, 1]}))
    np.testing.assert_array_equal(touching.Eval(context), [1, 0, 1, 1])
    latch(system, context)
    np.testing.assert_array_equal(touching.Eval(context), [1, 0, 1, 1])
    np.testing.assert_array_equal(touching.Eval(clone), believed)


def test_a_contact_lasts_for_a_step(fix_inputs, latch):
    system = ContactTrustSystem()
    contact = system.get_believed_contact_output_port()
    context = fix_inputs(system, touching=[1, 0, 0, 0], foot_height=HEIGHT)
    for touching, lasting in (([0, 1, 0, 0], [1, 1, 0, 0]), ([0, 0, 0, 0], [0, 1, 0, 0])):
        latch(system, context)
        fix_inputs(system, context, touching=touching, foot_height=HEIGHT)
        np.testing.assert_array_equal(contact.Eval(context), lasting)
