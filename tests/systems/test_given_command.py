"""The command from outside, or else the drawn one."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.systems.given_command import GivenCommand


@pytest.fixture
def system(trot):
    return GivenCommand(trot)


@pytest.fixture
def commanded(system, fix_inputs):
    """Returns command and dwell by what the inputs hold; the drawn ones are always there."""

    def evaluate(**given):
        context = fix_inputs(system, drawn_command=[0.3, -0.2], drawn_dwell=7.0, **given)
        return [
            port.Eval(context).tolist()
            for port in (
                system.get_command_output_port(),
                system.get_commanded_dwell_output_port(),
            )
        ]

    return evaluate


def test_each_input_is_taken_where_it_is_connected(commanded):
    assert commanded() == [[0.3, -0.2], [7.0]]
    assert commanded(command=[0.5, 0.1]) == [[0.5, 0.1], [7.0]]
    assert commanded(commanded_dwell=9.0) == [[0.3, -0.2], [9.0]]
    assert commanded(command=[0.5, 0.1], commanded_dwell=9.0) == [[0.5, 0.1], [9.0]]


def test_what_is_given_is_limited_to_what_the_gait_is_made_for(commanded):
    assert commanded(command=[3.0, -7.0], commanded_dwell=100.0) == [[1.0, -1.0], [11.0]]
    assert commanded(commanded_dwell=0.0) == [[0.3, -0.2], [6.0]]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"command": [np.nan, 0.0]}, r"input port 'command': is given .*nan"),
        ({"commanded_dwell": np.inf}, "input port 'commanded_dwell': is given"),
    ],
)
def test_numbers_that_are_not_finite_are_refused(commanded, given, message):
    with pytest.raises(InputError, match=message):
        commanded(**given)
