"""Reads messages of what the robot senses."""

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.link.messages import sensors_t
from glassgait.models.link.packing import unpack_imu, unpack_joints, unpack_touching
from glassgait.models.robots import quadruped
from glassgait.models.task.imu import N_IMU


class SensorsReceiver(LeafSystem):
    """Unpacks what the robot senses.

    .. pydrake_system::

        name: SensorsReceiver
        input_ports:
        - message
        output_ports:
        - joints
        - touching
        - imu

    Inputs: message (sensors_t).
    Outputs, at the message's instant: joints (24; rad, rad/s), positions, then velocities. touching
    (4, {0, 1}), FL FR RL RR. imu (9), the IMU's reading.
    State: none. Feedthrough: yes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._message_port = self.DeclareAbstractInputPort(
            "message", AbstractValue.Make(sensors_t())
        )
        of_message = {self.all_input_ports_ticket()}
        self._joints_port = self.DeclareVectorOutputPort(
            name="joints",
            size=2 * quadruped.N_JOINTS,
            calc=self._calc_joints,
            prerequisites_of_calc=of_message,
        )
        self._touching_port = self.DeclareVectorOutputPort(
            name="touching",
            size=quadruped.N_LEGS,
            calc=self._calc_touching,
            prerequisites_of_calc=of_message,
        )
        self._imu_port = self.DeclareVectorOutputPort(
            name="imu", size=N_IMU, calc=self._calc_imu, prerequisites_of_calc=of_message
        )

    def get_message_input_port(self) -> InputPort:
        """Takes the message."""
        return self._message_port

    def get_joints_output_port(self) -> OutputPort:
        """Returns the measured joints."""
        return self._joints_port

    def get_touching_output_port(self) -> OutputPort:
        """Returns which feet touch."""
        return self._touching_port

    def get_imu_output_port(self) -> OutputPort:
        """Returns the IMU's reading."""
        return self._imu_port

    def _calc_joints(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(unpack_joints(self._message_port.Eval(context)))

    def _calc_touching(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(unpack_touching(self._message_port.Eval(context)).astype(float))

    def _calc_imu(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(unpack_imu(self._message_port.Eval(context)))
