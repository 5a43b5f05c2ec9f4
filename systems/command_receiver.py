"""Reads messages of commands."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import command_t
from glassgait.models.link.packing import unpack_command, unpack_requested_mode
from glassgait.models.task.command import CommandRange


class CommandReceiver(LeafSystem):
    """Unpacks a command, limited to what the gait is made for.

    .. pydrake_system::

        name: CommandReceiver
        input_ports:
        - message
        output_ports:
        - command
        - commanded_dwell
        - requested_mode

    Inputs: message (command_t), the latest that came. Before the first the robot steps on the spot.
    Outputs: command (2; m/s, rad/s), forward speed and yaw rate, trunk frame. commanded_dwell (1,
    control steps). requested_mode (1), the number of what the operator requests of a day.
    State: none. Feedthrough: yes.
    """

    def __init__(self, limits: CommandRange) -> None:
        """
        Args:
            limits: The commands that the gait is made for.
        """
        super().__init__()
        self._limits = limits
        self._message_port = self.DeclareAbstractInputPort(
            "message", AbstractValue.Make(command_t())
        )
        of_message = {self.all_input_ports_ticket()}
        self._command_port = self.DeclareVectorOutputPort(
            name="command", size=2, calc=self._calc_command, prerequisites_of_calc=of_message
        )
        self._commanded_dwell_port = self.DeclareVectorOutputPort(
            name="commanded_dwell",
            size=1,
            calc=self._calc_commanded_dwell,
            prerequisites_of_calc=of_message,
        )
        self._requested_mode_port = self.DeclareVectorOutputPort(
            name="requested_mode",
            size=1,
            calc=self._calc_requested_mode,
            prerequisites_of_calc=of_message,
        )

    def get_message_input_port(self) -> InputPort:
        """Takes the message."""
        return self._message_port

    def get_command_output_port(self) -> OutputPort:
        """Gives forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_output_port(self) -> OutputPort:
        """Gives the commanded iterations in a state."""
        return self._commanded_dwell_port

    def get_requested_mode_output_port(self) -> OutputPort:
        """Gives the number of what the operator requests."""
        return self._requested_mode_port

    def _calc_command(self, context: Context, output: BasicVector) -> None:
        message = self._message_port.Eval(context)
        output.SetFromVector(unpack_command(message, self._limits).velocity)

    def _calc_commanded_dwell(self, context: Context, output: BasicVector) -> None:
        message = self._message_port.Eval(context)
        output.SetFromVector([float(unpack_command(message, self._limits).dwell)])

    def _calc_requested_mode(self, context: Context, output: BasicVector) -> None:
        message = self._message_port.Eval(context)
        output.SetFromVector([float(unpack_requested_mode(message))])
