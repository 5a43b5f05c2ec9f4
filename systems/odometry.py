"""Estimates base velocity and foot heights by leg odometry."""

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
from glassgait.models.estimation.imu import N_IMU
from glassgait.models.estimation.odometry import Odometry, OdometryState
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.systems.cached_value import CachedValue


class OdometrySystem(LeafSystem):
    """Estimates the body state from the IMU, the joints and the feet that stand.

    .. pydrake_system::

        name: OdometrySystem
        input_ports:
        - joints
        - imu
        - touching
        output_ports:
        - body_state
        - previous_foot_height
        - expected_foot_height

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. imu (9), the reading.
    touching (4, {0, 1}), FL FR RL RR, which feet seem to press on the ground at this instant.
    Outputs: body_state (7), base linear velocity scaled by 2 (m/s, trunk frame) and foot heights
    above the plane of the footholds (m). previous_foot_height (4, m), those heights at the control
    instant before, as `StateEstimator` has them; zero at first. expected_foot_height (4, m), of
    this instant, before it is known which feet touch; zero at first.
    State: whether there is an instant before (1), what odometry remembers of it (3 m/s, 12 m, 4,
    3 rad/s), and its foot heights (4, m), latched every 20 ms (unrestricted update). Feedthrough:
    all inputs to body_state, joints to expected_foot_height.
    """

    def __init__(self, robot: Robot, odometry: Odometry) -> None:
        super().__init__()
        self._robot, self._odometry = robot, odometry
        self._begun = self.DeclareDiscreteState(1)
        self._velocity = self.DeclareDiscreteState(3)
        self._footholds = self.DeclareDiscreteState(3 * quadruped.N_LEGS)
        self._touching = self.DeclareDiscreteState(quadruped.N_LEGS)
        self._turning = self.DeclareDiscreteState(3)
        self._foot_height = self.DeclareDiscreteState(quadruped.N_LEGS)
        self._joints_port = self.DeclareVectorInputPort("joints", 2 * quadruped.N_JOINTS)
        self._imu_port = self.DeclareVectorInputPort("imu", N_IMU)
        self._touching_port = self.DeclareVectorInputPort("touching", quadruped.N_LEGS)
        # The output and the update come from one advance.
        self._advanced = CachedValue(
            self, "odometry", self._calc_advanced, {self.all_input_ports_ticket(), self.xd_ticket()}
        )
        self._body_state_port = self.DeclareVectorOutputPort(
            name="body_state",
            size=N_ESTIMATED,
            calc=self._calc_body_state,
            prerequisites_of_calc={self._advanced.ticket()},
        )
        self._previous_foot_height_port = self.DeclareStateOutputPort(
            "previous_foot_height", self._foot_height
        )
        self._expected_foot_height_port = self.DeclareVectorOutputPort(
            name="expected_foot_height",
            size=quadruped.N_LEGS,
            calc=self._calc_expected_foot_height,
            prerequisites_of_calc={self._joints_port.ticket(), self.xd_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_joints_input_port(self) -> InputPort:
        """Takes the measured joints."""
        return self._joints_port

    def get_imu_input_port(self) -> InputPort:
        """Takes the IMU's reading."""
        return self._imu_port

    def get_touching_input_port(self) -> InputPort:
        """Takes which feet seem to touch at this instant."""
        return self._touching_port

    def get_body_state_output_port(self) -> OutputPort:
        """Returns the estimate."""
        return self._body_state_port

    def get_previous_foot_height_output_port(self) -> OutputPort:
        """Returns the foot heights that were estimated at the control instant before."""
        return self._previous_foot_height_port

    def get_expected_foot_height_output_port(self) -> OutputPort:
        """Returns how high feet are before it is known which of them touch."""
        return self._expected_foot_height_port

    def _before(self, context: Context) -> OdometryState | None:
        """Returns what is remembered of the instant before; None if there was none."""
        if context.get_discrete_state(self._begun).value()[0] < 0.5:
            return None
        return OdometryState(
            velocity=context.get_discrete_state(self._velocity).value(),
            footholds=context.get_discrete_state(self._footholds).value().reshape(-1, 3),
            touching=context.get_discrete_state(self._touching).value() > 0.5,
            turning=context.get_discrete_state(self._turning).value(),
        )

    def _measured_joints(self, context: Context) -> tuple[Array, Array]:
        joints = self._joints_port.Eval(context)
        return joints[: quadruped.N_JOINTS], joints[quadruped.N_JOINTS :]

    def _calc_advanced(self, context: Context) -> OdometryState:
        position, velocity = self._measured_joints(context)
        before = self._before(context)
        if before is None:
            return self._odometry.begin(self._robot, position)
        return self._odometry.advance(
            self._robot,
            before,
            joint_position=position,
            joint_velocity=velocity,
            imu=self._imu_port.Eval(context),
            touching=self._touching_port.Eval(context) > 0.5,
        )

    def _calc_body_state(self, context: Context, output: BasicVector) -> None:
        position, _ = self._measured_joints(context)
        now = self._advanced.Eval(context)
        output.SetFromVector(self._odometry.body_state(self._robot, now, position))

    def _calc_expected_foot_height(self, context: Context, output: BasicVector) -> None:
        before = self._before(context)
        position, _ = self._measured_joints(context)
        heights = (
            np.zeros(quadruped.N_LEGS)
            if before is None
            else self._odometry.expected_heights(self._robot, before, position)
        )
        output.SetFromVector(heights)

    def _latch(self, context: Context, state: State) -> None:
        now = self._advanced.Eval(context)
        heights = self._body_state_port.Eval(context)[-quadruped.N_LEGS :]
        for index, values in (
            (self._begun, [1.0]),
            (self._velocity, now.velocity),
            (self._footholds, now.footholds.ravel()),
            (self._touching, now.touching.astype(float)),
            (self._turning, now.turning),
            (self._foot_height, heights),
        ):
            state.get_mutable_discrete_state(index).SetFromVector(values)
