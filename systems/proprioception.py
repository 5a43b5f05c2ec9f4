"""Observes what needs no estimator."""

import math

from pydrake.systems.framework import InputPort, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task.observation import JOINT_NOISE, ObservationLayout, proprioception
from glassgait.systems.function import FunctionSystem


class Proprioception(FunctionSystem):
    """Assembles the part of the observation that the robot measures or knows.

    .. pydrake_system::

        name: Proprioception
        input_ports:
        - state
        - command
        - commanded_dwell
        - previous_action
        - rm_state
        - rm_iterations
        - uniform_noise
        output_ports:
        - proprioception

    Inputs: state (37), the plant's. command (2; m/s, rad/s), forward speed and yaw rate, trunk
    frame. commanded_dwell (1, control steps). previous_action (12). rm_state (n_states, one-hot).
    rm_iterations (1, control steps). uniform_noise (24, in [0, 1]), on joint positions, then
    velocities; may stay unconnected, and then there is no noise.
    Outputs: proprioception (40 + n_states), in the order of `ObservationLayout`.
    State: none. Feedthrough: all inputs. Converts to AutoDiffXd.
    """

    def __init__(self, robot: Robot, layout: ObservationLayout, noise_factor: float = 1.0) -> None:
        """
        Args:
            robot: The robot.
            layout: The observation's layout.
            noise_factor: Factor on the noise of the joints' sensors.

        Raises:
            ValueError: if the factor is negative or not finite.
        """
        if not 0.0 <= noise_factor < math.inf:
            raise ValueError(
                f"proprioception: noise_factor is {noise_factor}; it must be 0 or more"
            )
        self._robot = robot
        self._half_width = noise_factor * JOINT_NOISE
        super().__init__(
            inputs={
                "state": quadruped.N_POSITIONS + quadruped.N_VELOCITIES,
                "command": 2,
                "commanded_dwell": 1,
                "previous_action": quadruped.N_JOINTS,
                "rm_state": layout.n_machine_states,
                "rm_iterations": 1,
                "uniform_noise": 2 * quadruped.N_JOINTS,
            },
            optional=("uniform_noise",),
            output=("proprioception", layout.n_proprioceptive),
            function=self._observe,
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self.GetInputPort("state")

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

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise of the joints' sensors."""
        return self.GetInputPort("uniform_noise")

    def get_proprioception_output_port(self) -> OutputPort:
        """Gives the observation without the body state."""
        return self.GetOutputPort("proprioception")

    def _observe(
        self,
        state: Array,
        command: Array,
        commanded_dwell: Array,
        previous_action: Array,
        rm_state: Array,
        rm_iterations: Array,
        uniform_noise: Array | float = 0.5,
    ) -> Array:
        return proprioception(
            self._robot,
            command=command,
            joint_position=state[quadruped.JOINT_POSITION],
            joint_velocity=state[quadruped.JOINT_VELOCITY],
            previous_action=previous_action,
            rm_state=rm_state,
            rm_iterations=rm_iterations[0],
            commanded_dwell=commanded_dwell[0],
            joint_noise=self._half_width * (2.0 * uniform_noise - 1.0),
        )
