"""Measures the joints."""

import math

import numpy as np
from pydrake.systems.framework import InputPort, OutputPort

from glassgait.models.arrays import Array
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import JOINT_NOISE
from glassgait.systems.function import FunctionSystem


class JointSensor(FunctionSystem):
    """Measures positions and velocities of the joints, with the errors of their sensors.

    .. pydrake_system::

        name: JointSensor
        input_ports:
        - state
        - uniform_noise
        - encoder_bias
        output_ports:
        - joints

    Inputs: state (37), the plant's. uniform_noise (24, in [0, 1]), on positions, then velocities,
    and encoder_bias (12, rad), added to positions; either may stay unconnected, and then it is
    none.
    Outputs: joints (24; rad, rad/s), measured positions, then velocities.
    State: none. Feedthrough: all inputs. Converts to AutoDiffXd.
    """

    def __init__(self, noise_factor: float = 1.0) -> None:
        """
        Args:
            noise_factor: Factor on the noise.

        Raises:
            ValueError: if the factor is negative or not finite.
        """
        if not 0.0 <= noise_factor < math.inf:
            raise ValueError(f"joint sensor: noise_factor is {noise_factor}; it must be 0 or more")
        self._half_width = noise_factor * JOINT_NOISE
        super().__init__(
            inputs={
                "state": quadruped.N_POSITIONS + quadruped.N_VELOCITIES,
                "uniform_noise": 2 * quadruped.N_JOINTS,
                "encoder_bias": quadruped.N_JOINTS,
            },
            optional=("uniform_noise", "encoder_bias"),
            output=("joints", 2 * quadruped.N_JOINTS),
            function=self._measure,
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self.GetInputPort("state")

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise."""
        return self.GetInputPort("uniform_noise")

    def get_encoder_bias_input_port(self) -> InputPort:
        """Takes the constant errors of positions."""
        return self.GetInputPort("encoder_bias")

    def get_joints_output_port(self) -> OutputPort:
        """Returns what is measured."""
        return self.GetOutputPort("joints")

    def _measure(
        self,
        state: Array,
        uniform_noise: Array | float = 0.5,
        encoder_bias: Array | float = 0.0,
    ) -> Array:
        noise = self._half_width * (2.0 * uniform_noise - 1.0)
        bias = np.zeros(quadruped.N_JOINTS) + encoder_bias
        error = noise + np.concatenate([bias, np.zeros(quadruped.N_JOINTS)])
        joints = [state[quadruped.JOINT_POSITION], state[quadruped.JOINT_VELOCITY]]
        return np.concatenate(joints) + error
