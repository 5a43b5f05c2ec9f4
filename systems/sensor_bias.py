"""Constant errors of the sensors."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
)

from glassgait.models.arrays import Array
from glassgait.models.estimation.imu import N_IMU
from glassgait.models.robots import quadruped
from glassgait.models.task.randomization import Randomization, seed_of
from glassgait.systems.cached_value import CachedValue


class SensorBias(LeafSystem):
    """Draws the errors that a robot's sensors have for a whole episode.

    .. pydrake_system::

        name: SensorBias
        input_ports:
        - seed
        output_ports:
        - encoder_bias
        - imu_bias

    Inputs: seed (1), any number.
    Outputs: encoder_bias (12, rad), of measured joint positions. imu_bias (9), of the IMU's
    readings, in their order and units.
    State: none; a function of the seed. Feedthrough: seed to both outputs.
    """

    def __init__(self, randomization: Randomization) -> None:
        """
        Args:
            randomization: The greatest errors.
        """
        super().__init__()
        self._randomization = randomization
        self._seed_port = self.DeclareVectorInputPort("seed", 1)
        # Seeding a generator takes longer than anything else here.
        self._draw = CachedValue(
            self, "drawn biases", self._calc_draw, {self.all_input_ports_ticket()}
        )
        self._encoder_bias_port = self.DeclareVectorOutputPort(
            name="encoder_bias",
            size=quadruped.N_JOINTS,
            calc=self._calc_encoder_bias,
            prerequisites_of_calc={self._draw.ticket()},
        )
        self._imu_bias_port = self.DeclareVectorOutputPort(
            name="imu_bias",
            size=N_IMU,
            calc=self._calc_imu_bias,
            prerequisites_of_calc={self._draw.ticket()},
        )

    def get_seed_input_port(self) -> InputPort:
        """Takes the seed of the draw."""
        return self._seed_port

    def get_encoder_bias_output_port(self) -> OutputPort:
        """Returns the errors of joint positions."""
        return self._encoder_bias_port

    def get_imu_bias_output_port(self) -> OutputPort:
        """Returns the errors of the IMU."""
        return self._imu_bias_port

    def _calc_draw(self, context: Context) -> Array:
        generator = np.random.default_rng(seed_of(self._seed_port.Eval(context)))
        return self._randomization.biases(1, generator)[0]

    def _calc_encoder_bias(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._draw.Eval(context)[: quadruped.N_JOINTS])

    def _calc_imu_bias(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._draw.Eval(context)[quadruped.N_JOINTS :])
