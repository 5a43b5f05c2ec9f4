"""The fall monitor."""

import numpy as np
import pytest

from glassgait.models.robots.library import load_robot
from glassgait.models.task.termination import FAILURES, TerminationLimits
from glassgait.systems.fall_monitor import FallMonitor

A1 = load_robot()


def test_flags_the_failures(standing, fix_inputs):
    system = FallMonitor(A1)
    values = {"state": standing, "action": np.full(12, 3.0), "previous_action": np.zeros(12)}
    context = fix_inputs(system, **values)
    flags = dict(zip(FAILURES, system.get_failures_output_port().Eval(context), strict=True))
    assert flags.pop("abrupt_action") == 1
    assert not any(flags.values())


def test_its_limits_decide(standing, fix_inputs):
    values = {"state": standing, "action": np.zeros(12), "previous_action": np.zeros(12)}
    for height, low in ((0.2, 0), (0.4, 1)):
        system = FallMonitor(A1, TerminationLimits(trunk_height=height))
        flags = system.get_failures_output_port().Eval(fix_inputs(system, **values))
        assert flags.tolist() == [0, low, 0, 0, 0, 0, 0]


@pytest.mark.parametrize("port", ["state", "action"])
def test_a_value_that_is_not_finite_is_a_failure_of_its_own(port, standing, fix_inputs):
    system = FallMonitor(A1)
    values = {"state": standing, "action": np.zeros(12), "previous_action": np.zeros(12)}
    values[port] = np.full_like(values[port], np.nan)
    flags = system.get_failures_output_port().Eval(fix_inputs(system, **values))
    assert flags.tolist() == [0, 0, 0, 0, 0, 0, 1]


def test_clones_watch_their_own_robot(standing, fix_inputs):
    system = FallMonitor(A1)
    values = {"state": standing, "action": np.zeros(12), "previous_action": np.zeros(12)}
    context = fix_inputs(system, **values)
    fallen = standing.copy()
    fallen[6] = 0.1
    clone = fix_inputs(system, context.Clone(), state=fallen)
    port = system.get_failures_output_port()
    assert port.Eval(clone).any()
    assert not port.Eval(context).any()
