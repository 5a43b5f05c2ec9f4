"""Keeps what a policy asks for within limits, whatever it asks for."""

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.estimation.imu import N_IMU, ImuReading
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits


class TargetLimitsSystem(LeafSystem):
    """Applies the limits that come last between a policy and the joints.

    .. pydrake_system::

        name: TargetLimitsSystem
        input_ports:
        - action
        - previous_action
        - joints
        - imu
        output_ports:
        - limited_action

    Inputs: action (12), what the policy asks for. previous_action (12), within the limits. joints
    (24; rad, rad/s), measured positions, then velocities. imu (9), the IMU's reading in the trunk's
    frame, of which gravity's direction counts.
    Outputs: limited_action (12); what no limit touches is given to the last digit.
    State: none. Feedthrough: from all inputs. What is guaranteed of the output, and in which order
    limits come, says `glassgait.models.robots.target_limits`.
    """

    def __init__(self, robot: Robot, limits: TargetLimits) -> None:
        """
        Args:
            robot: What robot it is.
            limits: The limits.

        Raises:
            InputError: if the robot's default stance, where actions begin, is beyond them.
        """
        super().__init__()
        limits.check(robot)
        self._robot, self._limits = robot, limits
        n = quadruped.N_JOINTS
        self._action_port = self.DeclareVectorInputPort(name="action", size=n)
        self._previous_action_port = self.DeclareVectorInputPort(name="previous_action", size=n)
        self._joints_port = self.DeclareVectorInputPort(name="joints", size=2 * n)
        self._imu_port = self.DeclareVectorInputPort(name="imu", size=N_IMU)
        self._limited_action_port = self.DeclareVectorOutputPort(
            name="limited_action",
            size=n,
            calc=self._calc_limited_action,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_action_input_port(self) -> InputPort:
        """Takes what the policy asks for."""
        return self._action_port

    def get_previous_action_input_port(self) -> InputPort:
        """Takes the action of the step before."""
        return self._previous_action_port

    def get_joints_input_port(self) -> InputPort:
        """Takes the measured joints."""
        return self._joints_port

    def get_imu_input_port(self) -> InputPort:
        """Takes the IMU's reading."""
        return self._imu_port

    def get_limited_action_output_port(self) -> OutputPort:
        """Gives the action that the limits leave."""
        return self._limited_action_port

    def _calc_limited_action(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            self._limits.applied(
                self._robot,
                self._action_port.Eval(context),
                before=self._previous_action_port.Eval(context),
                position=self._joints_port.Eval(context)[: quadruped.N_JOINTS],
                gravity=ImuReading.of(self._imu_port.Eval(context)).gravity,
            )
        )
