"""The command that a planner gives, or else another."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError, shown
from glassgait.models.task.command import Command, limit_command
from glassgait.models.task.gait import Gait


class GivenCommand(LeafSystem):
    """Gives what is commanded from outside where that is connected, and else what is drawn.

    .. pydrake_system::

        name: GivenCommand
        input_ports:
        - command
        - commanded_dwell
        - drawn_command
        - drawn_dwell
        output_ports:
        - command
        - commanded_dwell

    Inputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame; commanded_dwell (1,
    control steps); each may stay unconnected. drawn_command (2), drawn_dwell (1), which pass
    unchanged in their place.
    Outputs: command (2), commanded_dwell (1), the nearest to what is given that the gait is made
    for.
    State: none. Feedthrough: command and drawn_command to command, commanded_dwell and drawn_dwell
    to commanded_dwell. An input that is connected and not finite raises an InputError.
    """

    def __init__(self, gait: Gait) -> None:
        """
        Args:
            gait: The gait, for its ranges.
        """
        super().__init__()
        self._gait = gait
        self._command_input = self.DeclareVectorInputPort("command", 2)
        self._dwell_input = self.DeclareVectorInputPort("commanded_dwell", 1)
        self._drawn_command_port = self.DeclareVectorInputPort("drawn_command", 2)
        self._drawn_dwell_port = self.DeclareVectorInputPort("drawn_dwell", 1)
        # Apart: a planner may choose the speed by the machine's state, which hangs on the dwell.
        self._command_output = self.DeclareVectorOutputPort(
            name="command",
            size=2,
            calc=self._calc_command,
            prerequisites_of_calc={self._command_input.ticket(), self._drawn_command_port.ticket()},
        )
        self._dwell_output = self.DeclareVectorOutputPort(
            name="commanded_dwell",
            size=1,
            calc=self._calc_dwell,
            prerequisites_of_calc={self._dwell_input.ticket(), self._drawn_dwell_port.ticket()},
        )

    def get_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate from outside; may stay unconnected."""
        return self._command_input

    def get_commanded_dwell_input_port(self) -> InputPort:
        """Takes the iterations in a state from outside; may stay unconnected."""
        return self._dwell_input

    def get_drawn_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate for where none are given."""
        return self._drawn_command_port

    def get_drawn_dwell_input_port(self) -> InputPort:
        """Takes the iterations in a state for where none are given."""
        return self._drawn_dwell_port

    def get_command_output_port(self) -> OutputPort:
        """Gives forward speed and yaw rate."""
        return self._command_output

    def get_commanded_dwell_output_port(self) -> OutputPort:
        """Gives the commanded iterations in a state."""
        return self._dwell_output

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        if not self._command_input.HasValue(context):
            output.SetFromVector(self._drawn_command_port.Eval(context))
            return
        given = Command(_finite(self._command_input, context), np.array(self._gait.dwell[0]))
        output.SetFromVector(limit_command(self._gait, given).velocity)

    def _calc_dwell(self, context: Context, output: BasicVector) -> None:
        if not self._dwell_input.HasValue(context):
            output.SetFromVector(self._drawn_dwell_port.Eval(context))
            return
        given = Command(np.zeros(2), _finite(self._dwell_input, context))
        output.SetFromVector(limit_command(self._gait, given).dwell)


def _finite(port: InputPort, context: Context) -> Array:
    given = np.asarray(port.Eval(context), dtype=float)
    if not np.isfinite(given).all():
        raise InputError(
            f"input port {port.get_name()!r}: is given {shown(given.tolist())}; give finite numbers"
        )
    return given
