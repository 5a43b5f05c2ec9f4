"""Observes what needs no estimator."""

from pydrake.systems.framework import InputPort, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.estimation.imu import N_IMU
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import ObservationLayout, proprioception
from glassgait.systems.function import FunctionSystem


class Proprioception(FunctionSystem):
    """Assembles the part of the observation that the robot measures or knows.

    .. pydrake_system::

        name: Proprioception
        input_ports:
        - joints
        - command
        - commanded_dwell
        - previous_action
        - rm_state
        - rm_iterations
        - imu
        output_ports:
        - proprioception

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. command (2; m/s, rad/s),
    forward speed and yaw rate, trunk frame. commanded_dwell (1, control steps). previous_action
    (12). rm_state (n_states, one-hot). rm_iterations (1, control steps). imu (9), the reading, only
    where the layout has an IMU.
    Outputs: proprioception (40 + n_states, 46 + n_states with an IMU), in the order of
    `ObservationLayout`.
    State: none. Feedthrough: all inputs. Converts to AutoDiffXd.
    """

    def __init__(self, robot: Robot, layout: ObservationLayout, *, limited: bool = False) -> None:
        """
        Args:
            robot: What robot it is.
            layout: What is observed.
            limited: Whether joints follow targets within their ranges alone, which are then what is
                observed of the previous action.
        """
        self._robot, self._limited = robot, limited
        super().__init__(
            inputs={
                "joints": 2 * quadruped.N_JOINTS,
                "command": 2,
                "commanded_dwell": 1,
                "previous_action": quadruped.N_JOINTS,
                "rm_state": layout.n_machine_states,
                "rm_iterations": 1,
                **({"imu": N_IMU} if layout.imu else {}),
            },
            output=("proprioception", layout.n_proprioceptive),
            function=self._observe,
        )

    def get_joints_input_port(self) -> InputPort:
        """Takes the measured joints."""
        return self.GetInputPort("joints")

    def get_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate."""
        return self.GetInputPort("command")

    def get_commanded_dwell_input_port(self) -> InputPort:
        """Takes the commanded iterations in a state."""
        return self.GetInputPort("commanded_dwell")

    def get_previous_action_input_port(self) -> InputPort:
        """Takes the action of the previous control step."""
        return self.GetInputPort("previous_action")

    def get_rm_state_input_port(self) -> InputPort:
        """Takes the reward machine's state."""
        return self.GetInputPort("rm_state")

    def get_rm_iterations_input_port(self) -> InputPort:
        """Takes the control steps spent in that state."""
        return self.GetInputPort("rm_iterations")

    def get_imu_input_port(self) -> InputPort:
        """Takes the IMU's reading; only where the layout has one."""
        return self.GetInputPort("imu")

    def get_proprioception_output_port(self) -> OutputPort:
        """Gives the observation without the body state."""
        return self.GetOutputPort("proprioception")

    def _observe(
        self,
        joints: Array,
        command: Array,
        commanded_dwell: Array,
        previous_action: Array,
        rm_state: Array,
        rm_iterations: Array,
        imu: Array | None = None,
    ) -> Array:
        return proprioception(
            self._robot,
            command=command,
            joint_position=joints[: quadruped.N_JOINTS],
            joint_velocity=joints[quadruped.N_JOINTS :],
            previous_action=previous_action,
            rm_state=rm_state,
            rm_iterations=rm_iterations[0],
            commanded_dwell=commanded_dwell[0],
            imu=imu,
            limited=self._limited,
        )
