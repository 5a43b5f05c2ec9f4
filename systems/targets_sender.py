"""Makes messages of joint targets."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import sensors_t, targets_t
from glassgait.models.link.packing import pack_targets
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot


class TargetsSender(LeafSystem):
    """Packs the joint targets that answer what a robot in another process senses.

    .. pydrake_system::

        name: TargetsSender
        input_ports:
        - action
        - sensors
        - damped
        output_ports:
        - message

    Inputs: action (12), of this control step. sensors (sensors_t), which it answers.
    damped (1, {0, 1}), whether joints are to have no stiffness; may stay unconnected, and is 0
    then.
    Outputs: message (targets_t), targets within the joints' ranges, the nearest there.
    State: none. Feedthrough: all inputs.
    """

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self._robot = robot
        self._action_port = self.DeclareVectorInputPort("action", quadruped.N_JOINTS)
        self._sensors_port = self.DeclareAbstractInputPort(
            "sensors", AbstractValue.Make(sensors_t())
        )
        self._damped_port = self.DeclareVectorInputPort("damped", 1)
        self._message_port = self.DeclareAbstractOutputPort(
            name="message",
            alloc=lambda: AbstractValue.Make(targets_t()),
            calc=self._calc_message,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_action_input_port(self) -> InputPort:
        """Takes the action."""
        return self._action_port

    def get_sensors_input_port(self) -> InputPort:
        """Takes the sensors that are answered."""
        return self._sensors_port

    def get_damped_input_port(self) -> InputPort:
        """Takes whether joints are damped."""
        return self._damped_port

    def get_message_output_port(self) -> OutputPort:
        """Gives the message."""
        return self._message_port

    def _calc_message(self, context: Context, output: AbstractValue) -> None:
        targets = self._robot.joint_targets(self._action_port.Eval(context), limited=True)
        port, answered = self._damped_port, self._sensors_port.Eval(context)
        damped = port.HasValue(context) and bool(port.Eval(context)[0] > 0.5)
        output.set_value(pack_targets(answered, targets, damped=damped))
