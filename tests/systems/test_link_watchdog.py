"""The watchdog over the link."""

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from glassgait.models.link.messages import targets_t
from glassgait.models.link.watchdog import (
    CROUCH,
    Phase,
    Watchdog,
    initial_watch,
    step_watch,
)
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.day import load_day
from glassgait.models.task.request import NO_MODE
from glassgait.systems.link_watchdog import LinkWatchdog, pack_watch, unpack_watch

A1, DAY = load_robot(), load_day()


SESSION, STEP = 9, 0.01
TARGETS = A1.default_stance + np.linspace(-0.3, 0.3, 12)
LEVEL = kinematics.standing_state(A1)
ON_ITS_SIDE = LEVEL.copy()
ON_ITS_SIDE[quadruped.QUATERNION] = np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0


def answer(time, session=SESSION, targets=TARGETS):
    message = targets_t()
    message.session, message.utime = session, round(1e6 * time)
    message.joint_position = list(targets)
    return AbstractValue.Make(message)


@pytest.fixture
def system():
    return LinkWatchdog(A1, Watchdog(), session=SESSION, time_step=STEP)


@pytest.fixture
def advance(system):
    """Takes the update of an instant, with a message."""
    simulator = Simulator(system)
    context = simulator.get_mutable_context()

    def run(until, message, state=LEVEL):
        system.get_message_input_port().FixValue(context, message)
        system.get_state_input_port().FixValue(context, state)
        simulator.AdvanceTo(until)
        return context

    return run


def test_passes_answers_on_and_lowers_the_robot_without_them(system, advance):
    def reported(context):
        return [
            port.Eval(context)
            for port in (
                system.get_targets_output_port(),
                system.get_phase_output_port(),
                system.get_followed_output_port(),
            )
        ]

    context = advance(0.005, answer(0.0))
    for value, expected in zip(reported(context), (TARGETS, Phase.FOLLOWING, 1), strict=True):
        np.testing.assert_array_equal(value, expected)
    clone = context.Clone()
    context = advance(0.045, answer(0.0))
    assert reported(context)[1:] == [[Phase.HOLDING], [1]]
    context = advance(3.005, answer(0.0))
    assert reported(context)[1:] == [[Phase.LOWERED], [0]]
    np.testing.assert_allclose(reported(context)[0], CROUCH)
    np.testing.assert_array_equal(reported(clone)[0], TARGETS)


def test_a_robot_on_its_side_does_not_rise(system, advance):
    advance(0.005, answer(0.0))
    advance(3.005, answer(0.0))
    for state, expected in ((ON_ITS_SIDE, Phase.TIPPED), (LEVEL, Phase.STANDING)):
        for step in range(50):
            instant = 3.01 + STEP * step + (0.0 if state is ON_ITS_SIDE else 0.5)
            context = advance(instant + 0.5 * STEP, answer(round(instant, 6)), state)
        assert system.get_phase_output_port().Eval(context) == [expected]


def test_answers_of_another_session_are_not_heard(system, advance):
    context = advance(0.005, answer(0.0, session=SESSION + 1))
    np.testing.assert_array_equal(system.get_targets_output_port().Eval(context), A1.default_stance)


def test_restarts_on_its_feet(system, advance):
    context = advance(0.005, answer(0.0))
    system.restart(context)
    assert system.get_followed_output_port().Eval(context) == [0]


def test_numbers_stand_for_a_watch_and_back():
    watch = step_watch(A1, initial_watch(A1), None, 1.0, Watchdog(), position=A1.default_stance)
    again = unpack_watch(pack_watch(watch))
    for one, other in zip(watch, again, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("day", "mode"), [(DAY.digest(), 3), ("another", NO_MODE), ("", NO_MODE)])
def test_gives_the_mode_of_its_own_day_alone(day, mode):
    system = LinkWatchdog(A1, Watchdog(), session=SESSION, time_step=STEP, day=DAY)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    message = answer(0.0)
    sent = message.get_mutable_value()
    sent.mode, sent.day, sent.damped = 3, day, True
    system.get_message_input_port().FixValue(context, message)
    system.get_state_input_port().FixValue(context, LEVEL)
    simulator.AdvanceTo(STEP)
    assert system.get_followed_output_port().Eval(context)[0]
    assert system.get_mode_output_port().Eval(context)[0] == mode


def test_refuses_a_plant_without_steps():
    with pytest.raises(ValueError, match="time_step"):
        LinkWatchdog(A1, Watchdog(), session=SESSION, time_step=0.0)
