"""The alternation schedule."""

import pytest
from pydrake.systems.framework import InputPortIndex

from glassgait.systems.alternation import AlternationSchedule

EXPERT, STUDENT = InputPortIndex(1), InputPortIndex(2)


@pytest.mark.parametrize(("period", "acts"), [(1, "EEEEEE"), (3, "ESSESS"), (0, "SSSSSS")])
def test_selects_the_expert_every_nth_control_step(period, acts):
    system = AlternationSchedule(period, EXPERT, STUDENT)
    context = system.CreateDefaultContext()
    chosen = ""
    for step in range(6):
        context.SetTime(step * 0.02)
        selected = system.get_port_selector_output_port().Eval(context)
        chosen += {EXPERT: "E", STUDENT: "S"}[selected]
    assert chosen == acts


def test_refuses_a_negative_period():
    with pytest.raises(ValueError, match="period"):
        AlternationSchedule(-1, EXPERT, STUDENT)


def test_clones_go_by_their_own_time():
    system = AlternationSchedule(2, EXPERT, STUDENT)
    context = system.CreateDefaultContext()
    clone = context.Clone()
    clone.SetTime(0.02)
    port = system.get_port_selector_output_port()
    assert (port.Eval(context), port.Eval(clone)) == (EXPERT, STUDENT)
