"""Observes what needs no estimator."""

import math

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort

from glassgait.models.a1 import robot
from glassgait.models.task.observation import JOINT_NOISE, ObservationLayout, proprioception


class Proprioception(LeafSystem):
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
    State: none. Feedthrough: all inputs.
    """

    def __init__(self, layout: ObservationLayout, noise_factor: float = 1.0) -> None:
        """
        Args:
            layout: The observation's layout.
            noise_factor: Factor on the noise of the joints' sensors.

        Raises:
            ValueError: if the factor is negative or not finite.
        """
        super().__init__()
        if not 0.0 <= noise_factor < math.inf:
            raise ValueError(
                f"proprioception: noise_factor is {noise_factor}; it must be 0 or more"
            )
        self._half_width = noise_factor * JOINT_NOISE
        declare = self.DeclareVectorInputPort
        self._state_port = declare("state", robot.N_POSITIONS + robot.N_VELOCITIES)
        self._command_port = declare("command", 2)
        self._commanded_dwell_port = declare("commanded_dwell", 1)
        self._previous_action_port = declare("previous_action", robot.N_JOINTS)
        self._rm_state_port = declare("rm_state", layout.n_machine_states)
        self._rm_iterations_port = declare("rm_iterations", 1)
        self._uniform_noise_port = declare("uniform_noise", 2 * robot.N_JOINTS)
        self._proprioception_port = self.DeclareVectorOutputPort(
            name="proprioception",
            size=layout.n_proprioceptive,
            calc=self._calc_proprioception,
            prerequisites_of_calc={self.all_input_ports_ticket()},
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_input_port(self) -> InputPort:
        """Takes the commanded iterations in a state."""
        return self._commanded_dwell_port

    def get_previous_action_input_port(self) -> InputPort:
        """Takes the action of the previous control step."""
        return self._previous_action_port

    def get_rm_state_input_port(self) -> InputPort:
        """Takes the reward machine's state."""
        return self._rm_state_port

    def get_rm_iterations_input_port(self) -> InputPort:
        """Takes the control steps spent in that state."""
        return self._rm_iterations_port

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise of the joints' sensors."""
        return self._uniform_noise_port

    def get_proprioception_output_port(self) -> OutputPort:
        """Gives the observation without the body state."""
        return self._proprioception_port

    def _calc_proprioception(self, context: Context, output: BasicVector) -> None:
        state = self._state_port.Eval(context)
        noise = 0.0
        if self._uniform_noise_port.HasValue(context):
            noise = self._half_width * (2.0 * self._uniform_noise_port.Eval(context) - 1.0)
        output.SetFromVector(
            proprioception(
                command=self._command_port.Eval(context),
                joint_position=state[robot.JOINT_POSITION],
                joint_velocity=state[robot.JOINT_VELOCITY],
                previous_action=self._previous_action_port.Eval(context),
                rm_state=self._rm_state_port.Eval(context),
                rm_iterations=self._rm_iterations_port.Eval(context)[0],
                commanded_dwell=self._commanded_dwell_port.Eval(context)[0],
                joint_noise=noise,
            )
        )
