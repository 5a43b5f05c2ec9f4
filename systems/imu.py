"""Measures by the IMU in the trunk."""

import math

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.arrays import Array
from glassgait.models.estimation.imu import IMU_NOISE, N_IMU, measure_imu
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.systems.cached_value import CachedValue


class ImuSensor(LeafSystem):
    """Measures angular velocity, change of velocity and gravity's direction.

    Drake's `Gyroscope` measures the first as well, without errors; its `Accelerometer` measures an
    instant, of which `glassgait.models.estimation.imu` needs the sum over a control period.

    .. pydrake_system::

        name: ImuSensor
        input_ports:
        - state
        - uniform_noise
        - imu_bias
        output_ports:
        - imu

    Inputs: state (37), the plant's. uniform_noise (9, in [0, 1]) and imu_bias (9), added to a
    reading; either may stay unconnected, and then it is none.
    Outputs: imu (9; rad/s, m/s, none), the reading of `models.estimation.imu`, of this control
    instant or as many before as it is late; at first the first.
    State: whether there is an instant before (1), the trunk's velocity then (3, world frame), and
    the readings since then that are still to come (delay × 9), latched every period, by default 20
    ms (unrestricted update). Drake's `DiscreteTimeDelay` would latch after the velocity had been
    overwritten. Feedthrough: all inputs.
    """

    def __init__(
        self,
        gravity: Array,
        delay: int = 0,
        noise_factor: float = 1.0,
        period: float = CONTROL_PERIOD,
    ) -> None:
        """
        Args:
            gravity: Acceleration by gravity (3; m/s², world frame).
            delay: Periods by which readings are late.
            noise_factor: Factor on the noise.
            period: Time from one reading to the next (s). Errors are those of a control period; of
                the change of velocity a shorter one has its share.

        Raises:
            ValueError: if the delay is negative, the factor negative or not finite, or the period
                not positive.
        """
        super().__init__()
        if delay < 0:
            raise ValueError(f"IMU: delay is {delay}; it must be 0 or more")
        if not 0.0 <= noise_factor < math.inf:
            raise ValueError(f"IMU: noise_factor is {noise_factor}; it must be 0 or more")
        if not period > 0.0:
            raise ValueError(f"IMU: period is {period}; it must be above 0")
        self._gravity, self._period = np.array(gravity, dtype=float), period
        self._error_share = np.repeat([1.0, period / CONTROL_PERIOD, 1.0], 3)
        self._half_width = noise_factor * IMU_NOISE
        self._begun = self.DeclareDiscreteState(1)
        self._velocity_before = self.DeclareDiscreteState(3)
        self._coming = self.DeclareDiscreteState(delay * N_IMU)
        self._state_port = self.DeclareVectorInputPort(
            "state", quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        )
        self._uniform_noise_port = self.DeclareVectorInputPort("uniform_noise", N_IMU)
        self._imu_bias_port = self.DeclareVectorInputPort("imu_bias", N_IMU)
        # The output and the update come from one measurement.
        self._readings = CachedValue(
            self, "readings", self._calc_readings, {self.all_input_ports_ticket(), self.xd_ticket()}
        )
        self._imu_port = self.DeclareVectorOutputPort(
            name="imu",
            size=N_IMU,
            calc=self._calc_imu,
            prerequisites_of_calc={self._readings.ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=period, offset_sec=0.0, update=self._latch
        )

    def get_state_input_port(self) -> InputPort:
        """Takes the plant's state."""
        return self._state_port

    def get_uniform_noise_input_port(self) -> InputPort:
        """Takes the noise."""
        return self._uniform_noise_port

    def get_imu_bias_input_port(self) -> InputPort:
        """Takes the constant errors."""
        return self._imu_bias_port

    def get_imu_output_port(self) -> OutputPort:
        """Returns the reading."""
        return self._imu_port

    def _calc_readings(self, context: Context) -> Array:
        """Takes this instant's reading and those that are still to come, the latest first."""
        state = self._state_port.Eval(context)
        has_begun = context.get_discrete_state(self._begun).value()[0] > 0.5
        before = state[quadruped.LINEAR_VELOCITY]
        if has_begun:
            before = context.get_discrete_state(self._velocity_before).value()
        reading = measure_imu(state, before, self._gravity, self._period)
        if self._uniform_noise_port.HasValue(context):
            uniform = self._uniform_noise_port.Eval(context)
            noise = self._half_width * (2.0 * uniform - 1.0)
            reading = reading + self._error_share * noise
        if self._imu_bias_port.HasValue(context):
            reading = reading + self._error_share * self._imu_bias_port.Eval(context)
        coming = context.get_discrete_state(self._coming).value().reshape(-1, N_IMU)
        readings = np.empty((1 + len(coming), N_IMU))
        readings[0] = reading
        readings[1:] = coming if has_begun else reading
        return readings

    def _calc_imu(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._readings.Eval(context)[-1])

    def _latch(self, context: Context, state: State) -> None:
        velocity = self._state_port.Eval(context)[quadruped.LINEAR_VELOCITY]
        state.get_mutable_discrete_state(self._begun).SetFromVector([1.0])
        state.get_mutable_discrete_state(self._velocity_before).SetFromVector(velocity)
        coming = self._readings.Eval(context)[:-1].ravel()
        state.get_mutable_discrete_state(self._coming).SetFromVector(coming)
