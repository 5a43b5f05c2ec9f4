"""What the operator of a robot on Unitree's wire asks for."""

import numpy as np

from glassgait.models.link.operator import RemoteOperator
from glassgait.models.link.remote import REQUESTED_BY, Button, Remote, Sticks
from glassgait.models.task.day import REQUESTS

FREE = Remote.untouched()


def test_what_was_requested_last_is_asked_for_until_another_is(trot):
    operator = RemoteOperator(trot, Sticks(), 8.0)
    assert operator(FREE).requested_mode == REQUESTS.index("sit")
    for name in ("stand", "walk", "sit", "walk"):
        operator(FREE._replace(buttons=REQUESTED_BY[name]))
        assert operator(FREE).requested_mode == REQUESTS.index(name)


def test_of_two_buttons_the_calmer_request_counts(trot):
    operator = RemoteOperator(trot, Sticks(), 8.0)
    pressed = REQUESTED_BY["walk"] | REQUESTED_BY["sit"]
    assert operator(FREE._replace(buttons=pressed)).requested_mode == REQUESTS.index("sit")
    pressed = REQUESTED_BY["walk"] | REQUESTED_BY["stand"] | Button.X
    assert operator(FREE._replace(buttons=pressed)).requested_mode == REQUESTS.index("stand")


def test_sticks_command(trot):
    asked = RemoteOperator(trot, Sticks(), 7.0)(FREE._replace(ly=1.0, rx=-1.0))
    np.testing.assert_allclose(asked.command.velocity, [trot.max_speed, trot.max_yaw_rate])
    assert asked.command.dwell == 7.0
