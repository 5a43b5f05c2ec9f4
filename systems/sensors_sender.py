"""Makes messages of what the robot senses."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort

from glassgait.models.export.binding import Sensors, sensed
from glassgait.models.link.messages import sensors_t
from glassgait.models.link.packing import pack_sensors
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import JOINT_NOISE


class SensorsSender(LeafSystem):
    """Senses joints and feet, and packs that for a controller in another process.

    .. pydrake_system::

        name: SensorsSender
        input_ports:
        - state
        - followed
        - uniform_noise
        output_ports:
        - message

    Inputs: state (37), the plant's. followed (1, {0, 1}), whether the joints follow the
    controller's targets. uniform_noise (24, in [0, 1]), on joint positions, then velocities; may
    stay unconnected, and then there is no noise.
    Outputs: message (sensors_t), of this instant; read it at control instants.
    State: none. Feedthrough: all inputs.
    """

    def __init__(self, robot: Robot, session: int, noise_factor: float = 1.0) -> None:
        """
        Args:
            robot: The robot.
            session: Number of this start of the robot's process.
            noise_factor: Factor on the noise of the joints' sensors.

        Raises:
            ValueError: if the factor is negative or not finite.
        """
        super().__init__()
        if not 0.0 <= noise_factor < np.inf:
            raise ValueError(
                f"sensors sender: noise_factor is {noise_factor}; it must be 0 or more"
            )
        self._robot = robot
        self._session, self._half_width = session, noise_factor * JOINT_NOISE
        declare = self.DeclareVectorInputPort
        self._state_port = declare("state", quadruped.N_POSITIONS + quadruped.N_VELOCITIES)
        self._followed_port = declare("followed", 1)
        self._uniform_noise_port = declare("uniform_noise", 2 * quadruped.N_JOINTS)
        self._message_port = self.DeclareAbstractOutputPort(
            name="message",
            alloc=lambda: AbstractValue.Make(sensors_t()),
            calc=self._calc_message,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.time_ticket()},
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_followed_input_port(self) -> InputPort:
        """Takes whether the controller is followed."""
        return self._followed_port

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise of the joints' sensors."""
        return self._uniform_noise_port

    def get_message_output_port(self) -> OutputPort:
        """Gives the message."""
        return self._message_port

    def _calc_message(self, context: Context, output: AbstractValue) -> None:
        exact = sensed(self._robot, self._state_port.Eval(context))
        measured = np.concatenate([exact.joint_position, exact.joint_velocity])
        if self._uniform_noise_port.HasValue(context):
            measured += self._half_width * (2.0 * self._uniform_noise_port.Eval(context) - 1.0)
        sensors = Sensors(*np.split(measured, 2), exact.touching)
        followed = bool(self._followed_port.Eval(context)[0] > 0.5)
        message = pack_sensors(self._session, context.get_time(), sensors, followed=followed)
        output.set_value(message)
