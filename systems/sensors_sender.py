"""Makes messages of what the robot senses."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import sensors_t
from glassgait.models.link.packing import pack_sensors
from glassgait.models.robots import quadruped
from glassgait.models.task.imu import N_IMU


class SensorsSender(LeafSystem):
    """Packs what the robot senses for a controller in another process.

    .. pydrake_system::

        name: SensorsSender
        input_ports:
        - joints
        - touching
        - imu
        - followed
        output_ports:
        - message

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. touching (4, {0, 1}), FL
    FR RL RR, at this instant. imu (9), the IMU's reading. followed (1, {0, 1}), whether the joints
    follow the controller's targets.
    Outputs: message (sensors_t), of this instant; read it at control instants.
    State: none. Feedthrough: all inputs.
    """

    def __init__(self, session: int) -> None:
        """
        Args:
            session: Number of this start of the robot's process.
        """
        super().__init__()
        self._session = session
        declare = self.DeclareVectorInputPort
        self._joints_port = declare("joints", 2 * quadruped.N_JOINTS)
        self._touching_port = declare("touching", quadruped.N_LEGS)
        self._imu_port = declare("imu", N_IMU)
        self._followed_port = declare("followed", 1)
        self._message_port = self.DeclareAbstractOutputPort(
            name="message",
            alloc=lambda: AbstractValue.Make(sensors_t()),
            calc=self._calc_message,
            prerequisites_of_calc={self.all_input_ports_ticket(), self.time_ticket()},
        )

    def get_joints_input_port(self) -> InputPort:
        """Takes the measured joints."""
        return self._joints_port

    def get_touching_input_port(self) -> InputPort:
        """Takes which feet touch."""
        return self._touching_port

    def get_imu_input_port(self) -> InputPort:
        """Takes the IMU's reading."""
        return self._imu_port

    def get_followed_input_port(self) -> InputPort:
        """Takes whether the controller is followed."""
        return self._followed_port

    def get_message_output_port(self) -> OutputPort:
        """Gives the message."""
        return self._message_port

    def _calc_message(self, context: Context, output: AbstractValue) -> None:
        message = pack_sensors(
            self._session,
            context.get_time(),
            joints=self._joints_port.Eval(context),
            touching=self._touching_port.Eval(context) > 0.5,
            imu=self._imu_port.Eval(context),
            followed=bool(self._followed_port.Eval(context)[0] > 0.5),
        )
        output.set_value(message)
