"""Contact sensors that are wrong now and then."""

import numpy as np
import pytest

from glassgait.models.estimation.contact import stuck_sensors
from glassgait.systems.contact_sensor import ContactSensor


def sensed(system, context):
    return system.get_sensed_contact_output_port().Eval(context).tolist()


def test_flips_where_the_noise_is_below_the_share(fix_inputs):
    system = ContactSensor(0.1)
    context = fix_inputs(system, touching=[1, 1, 0, 0], uniform_noise=[0.05, 0.1, 0.09, 0.5])
    assert sensed(system, context) == [0, 1, 1, 0]


def test_what_is_stuck_always_reads_the_same(fix_inputs):
    system = ContactSensor(0.5, stuck_sensors(("FL",), ("RR",)))
    for touching in (0, 1):
        context = fix_inputs(system, touching=4 * [touching])
        assert sensed(system, context) == [0, touching, touching, 1]
        flipped = fix_inputs(system, context.Clone(), uniform_noise=np.zeros(4))
        assert sensed(system, flipped) == [0, 1 - touching, 1 - touching, 1]


def test_contexts_share_nothing(fix_inputs):
    system = ContactSensor(0.5)
    context = fix_inputs(system, touching=np.ones(4), uniform_noise=np.zeros(4))
    clone = fix_inputs(system, context.Clone(), uniform_noise=np.ones(4))
    assert sensed(system, context) == [0, 0, 0, 0]
    assert sensed(system, clone) == [1, 1, 1, 1]


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_refuses_what_is_no_share(share):
    with pytest.raises(ValueError, match="must be from 0 to 1"):
        ContactSensor(share)
