"""Reads messages of what the robot senses."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import sensors_t
from glassgait.models.link.packing import unpack_state, unpack_touching
from glassgait.models.robots import quadruped


class SensorsReceiver(LeafSystem):
    """Unpacks what the robot senses.

    .. pydrake_system::

        name: SensorsReceiver
        input_ports:
        - message
        output_ports:
        - state
        - touching

    Inputs: message (sensors_t).
    Outputs: state (37), the plant's as far as sensors measure it: the joints' entries, and NaN for
    the trunk's. touching (4, {0, 1}), FL FR RL RR, at the message's instant.
    State: none. Feedthrough: yes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._message_port = self.DeclareAbstractInputPort(
            "message", AbstractValue.Make(sensors_t())
        )
        of_message = {self.all_input_ports_ticket()}
        self._state_port = self.DeclareVectorOutputPort(
            name="state",
            size=quadruped.N_POSITIONS + quadruped.N_VELOCITIES,
            calc=self._calc_state,
            prerequisites_of_calc=of_message,
        )
        self._touching_port = self.DeclareVectorOutputPort(
            name="touching",
            size=quadruped.N_LEGS,
            calc=self._calc_touching,
            prerequisites_of_calc=of_message,
        )

    def get_message_input_port(self) -> InputPort:
        """Takes the message."""
        return self._message_port

    def get_state_output_port(self) -> OutputPort:
        """Gives the joints, in the plant's state."""
        return self._state_port

    def get_touching_output_port(self) -> OutputPort:
        """Returns which feet touch."""
        return self._touching_port

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(unpack_state(self._message_port.Eval(context)))

    def _calc_touching(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(unpack_touching(self._message_port.Eval(context)).astype(float))
