"""Makes messages of commands."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import command_t
from glassgait.models.link.packing import pack_command
from glassgait.models.task.command import Command


class CommandSender(LeafSystem):
    """Packs a command for a controller in another process.

    .. pydrake_system::

        name: CommandSender
        input_ports:
        - command
        - commanded_dwell
        - requested_mode
        output_ports:
        - message

    Inputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame. commanded_dwell (1,
    control steps). requested_mode (1), the number of what the operator requests of a day; may stay
    unconnected, and is 0 then, `sit`.
    Outputs: message (command_t), of this instant; read it at control instants.
    State: none. Feedthrough: all inputs.
    """

    def __init__(self, session: int) -> None:
        """
        Args:
            session: Number of this start of the sender.
        """
        super().__init__()
        self._session = session
        self._command_port = self.DeclareVectorInputPort("command", 2)
        self._commanded_dwell_port = self.DeclareVectorInputPort("commanded_dwell", 1)
        self._requested_mode_port = self.DeclareVectorInputPort("requested_mode", 1)
        self._message_port = self.DeclareAbstractOutputPort(
            name="message",
            alloc=lambda: AbstractValue.Make(command_t()),
            calc=self._calc_message,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.time_ticket()},
        )

    def get_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_input_port(self) -> InputPort:
        """Takes the commanded iterations in a state."""
        return self._commanded_dwell_port

    def get_requested_mode_input_port(self) -> InputPort:
        """Takes the number of what the operator requests."""
        return self._requested_mode_port

    def get_message_output_port(self) -> OutputPort:
        """Gives the message."""
        return self._message_port

    def _calc_message(self, context: Context, output: AbstractValue) -> None:
        dwell = np.array(self._commanded_dwell_port.Eval(context)[0])
        command = Command(self._command_port.Eval(context), dwell)
        port = self._requested_mode_port
        requested = round(port.Eval(context)[0]) if port.HasValue(context) else 0
        output.set_value(pack_command(self._session, context.get_time(), command, requested))
