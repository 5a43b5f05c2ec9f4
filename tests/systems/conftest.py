"""What the tests of leaf systems share."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem


@pytest.fixture
def assert_sizes_are_checked() -> Callable[[LeafSystem], None]:
    """Gives every input port a value one entry too short, and one too long: both are refused."""

    def check(system: LeafSystem) -> None:
        context = system.CreateDefaultContext()
        assert system.num_input_ports() > 0
        for index in range(system.num_input_ports()):
            port = system.get_input_port(index)
            for size in (port.size() - 1, port.size() + 1):
                with pytest.raises(RuntimeError, match=f"port '{port.get_name()}'"):
                    port.FixValue(context, np.zeros(size))

    return check
