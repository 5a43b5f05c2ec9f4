"""The delay of actions."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.systems.action_delay import ActionDelay


def passed_on(system, context):
    return system.get_delayed_action_output_port().Eval(context)[0]


@pytest.mark.parametrize(
    ("latency", "time_step"),
    [
        (0.01, 0.01),
        (0.01, 0.0025),
        (0.0075, 0.0025),
        (0.013, 0.0),
        (0.03, 0.01),
        (0.0325, 0.0025),
        (0.033, 0.0),
    ],
)
def test_what_is_held_is_passed_on_late_in_every_period(latency, time_step, fix_inputs):
    system = ActionDelay(latency, time_step)
    context = fix_inputs(system, held_action=np.zeros(12))
    simulator = Simulator(system, context)
    simulator.Initialize()
    for period in range(1, 120):
        start = 0.02 * (period - 1)
        fix_inputs(system, context, held_action=np.full(12, float(period)))
        coming, phase = (period, latency) if latency < 0.02 else (period - 1, latency - 0.02)
        simulator.AdvanceTo(start + phase - 1e-6)
        assert passed_on(system, context) == max(coming - 1, 0)
        simulator.AdvanceTo(start + phase + 1e-6)
        assert passed_on(system, context) == coming
        simulator.AdvanceTo(start + 0.02 - 1e-7)
        assert passed_on(system, context) == coming


@pytest.mark.parametrize("time_step", [0.01, 0.0])
@pytest.mark.parametrize("periods", [1, 2])
def test_after_whole_periods_it_takes_what_was_held_before_the_instant(
    time_step, periods, fix_inputs
):
    system = ActionDelay(0.02 * periods, time_step)
    context = fix_inputs(system, held_action=np.ones(12))
    simulator = Simulator(system, context)
    simulator.Initialize()
    simulator.AdvanceTo(0.02 * periods + 0.01)
    assert passed_on(system, context) == 1


def test_clones_delay_their_own(fix_inputs, latch):
    system = ActionDelay(0.01, 0.01)
    context = fix_inputs(system, held_action=np.ones(12))
    clone = context.Clone()
    latch(system, context)
    assert passed_on(system, context) == 1
    assert passed_on(system, clone) == 0


@pytest.mark.parametrize(
    ("latency", "time_step", "message"),
    [
        (0.0, 0.01, "must be above 0"),
        (0.041, 0.0, "must be above 0"),
        (0.005, 0.01, "must be a multiple of 0.01"),
    ],
)
def test_refuses_latencies_that_cannot_be(latency, time_step, message):
    with pytest.raises(ValueError, match=message):
        ActionDelay(latency, time_step)
