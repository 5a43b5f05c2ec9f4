"""What a controller reads of a command."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue

from glassgait.models.link.messages import command_t
from glassgait.systems.command_receiver import CommandReceiver


@pytest.fixture
def received(trot):
    """Returns what is read from a message."""
    system = CommandReceiver(trot)

    def read(session=1, speed=0.5, yaw_rate=-0.2, dwell=8.0):
        message = command_t()
        message.session, message.speed, message.yaw_rate = session, speed, yaw_rate
        message.dwell = dwell
        context = system.CreateDefaultContext()
        system.get_message_input_port().FixValue(context, AbstractValue.Make(message))
        velocity = system.get_command_output_port().Eval(context.Clone())
        return [*velocity, *system.get_commanded_dwell_output_port().Eval(context)]

    return read


def test_gives_the_command(received):
    assert received() == [0.5, -0.2, 8.0]


def test_takes_the_nearest_that_the_gait_is_made_for(received, trot):
    low, high = trot.dwell
    assert received(speed=9.0, yaw_rate=-9.0, dwell=99) == [
        trot.max_speed,
        -trot.max_yaw_rate,
        high,
    ]
    assert received(dwell=0)[2] == low


@pytest.mark.parametrize("bad", [{"session": 0}, {"speed": np.nan}, {"dwell": np.inf}])
def test_steps_on_the_spot_without_a_sound_command(received, trot, bad):
    assert received(**bad) == [0.0, 0.0, sum(trot.dwell) // 2]


@pytest.mark.parametrize(
    ("sent", "read"), [(0, 0), (1, 1), (2, 2), (3, 0), (-1, 0), (2**31 - 1, 0)]
)
def test_a_request_without_a_number_of_its_own_is_to_sit(sent, read, trot):
    system, message = CommandReceiver(trot), command_t()
    message.session, message.requested_mode = 1, sent
    context = system.CreateDefaultContext()
    system.get_message_input_port().FixValue(context, AbstractValue.Make(message))
    assert system.get_requested_mode_output_port().Eval(context) == [read]
