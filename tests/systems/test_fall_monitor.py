"""The fall monitor."""

import numpy as np

from models.task.termination import FAILURES
from systems.fall_monitor import FallMonitor


def test_ports(port_sizes, feedthrough):
    system = FallMonitor()
    found, outputs = port_sizes(system)
    assert found == {"state": 37, "action": 12, "previous_action": 12}
    assert outputs == {"failures": 6}
    assert feedthrough(system) == {(name, "failures") for name in found}


def test_flags_the_failures(standing, fix_inputs):
    system = FallMonitor()
    values = {"state": standing, "action": np.full(12, 3.0), "previous_action": np.zeros(12)}
    context = fix_inputs(system, **values)
    flags = dict(zip(FAILURES, system.get_failures_output_port().Eval(context), strict=True))
    assert flags.pop("abrupt_action") == 1
    assert not any(flags.values())
