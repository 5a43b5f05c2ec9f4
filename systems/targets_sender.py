"""Makes messages of joint targets."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import sensors_t, targets_t
from glassgait.models.link.packing import pack_targets
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.request import NO_MODE


class TargetsSender(LeafSystem):
    """Packs the joint targets that answer what a robot in another process senses.

    .. pydrake_system::

        name: TargetsSender
        input_ports:
        - action
        - sensors
        - damped
        - mode
        output_ports:
        - message

    Inputs: action (12), of this control step. sensors (sensors_t), which it answers.
    damped (1, {0, 1}), whether joints are to have no stiffness; may stay unconnected, and is 0
    then. mode (1), number of the mode that the controller's day is in; may stay unconnected, and is
    -1 then, as without a day.
    Outputs: message (targets_t), targets within the joints' ranges, the nearest there.
    State: none. Feedthrough: all inputs.
    """

    def __init__(self, robot: Robot, *, day: str = "") -> None:
        """
        Args:
            robot: The robot.
            day: Digest of the controller's day; empty without one.
        """
        super().__init__()
        self._robot, self._day = robot, day
        self._action_port = self.DeclareVectorInputPort("action", quadruped.N_JOINTS)
        self._sensors_port = self.DeclareAbstractInputPort(
            "sensors", AbstractValue.Make(sensors_t())
        )
        self._damped_port = self.DeclareVectorInputPort("damped", 1)
        self._mode_port = self.DeclareVectorInputPort("mode", 1)
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

    def get_mode_input_port(self) -> InputPort:
        """Takes the number of the day's mode."""
        return self._mode_port

    def get_message_output_port(self) -> OutputPort:
        """Gives the message."""
        return self._message_port

    def _calc_message(self, context: Context, output: AbstractValue) -> None:
        targets = self._robot.joint_targets(self._action_port.Eval(context), limited=True)
        damped = self._given(self._damped_port, context, 0.0) > 0.5
        mode = round(self._given(self._mode_port, context, NO_MODE))
        answered = self._sensors_port.Eval(context)
        message = pack_targets(answered, targets, damped=damped, mode=mode, day=self._day)
        output.set_value(message)

    def _given(self, port: InputPort, context: Context, default: float) -> float:
        return float(port.Eval(context)[0]) if port.HasValue(context) else default
