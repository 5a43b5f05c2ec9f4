"""Decides what the joints do over a robot's day, and when its policy acts."""

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
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.robots.target_limits import TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.day import Day
from glassgait.models.task.imu import N_IMU
from glassgait.models.task.mode_machine import (
    IntArray,
    ModeMachine,
    ModeReadings,
    ModeState,
    ModeStep,
)
from glassgait.systems.cached_value import CachedValue


class ModeMachineSystem(LeafSystem):
    """Steps the modes of a day between a policy and the limits of its targets.

    .. pydrake_system::

        name: ModeMachineSystem
        input_ports:
        - action
        - previous_action
        - joints
        - imu
        - command
        - requested_mode
        output_ports:
        - asked_action
        - served_command
        - mode
        - acts
        - damped
        - acted

    Inputs: action (12), what the policy asks for. previous_action (12), of the step before, as
    limits left it. joints (24; rad, rad/s), measured positions, then velocities. imu (9), the IMU's
    reading in the trunk's frame. command (2; m/s, rad/s), the operator's. requested_mode (1), the
    number of what the operator requests (`REQUESTS`); may stay unconnected, and is 0 then, `sit`.
    Outputs: asked_action (12), what is asked of the joints, before limits. served_command (2; m/s,
    rad/s), the command that the policy is given. mode (1), its number. acts (1, {0, 1}), whether
    the policy is followed. damped (1, {0, 1}), whether joints are damped alone. acted (1, {0, 1}),
    whether the policy was followed at the control step before.
    State: mode, steps in it, idle steps, unsound steps, and the action at which the mode began
    (16), latched every 20 ms (unrestricted update). Feedthrough: command and requested_mode to
    served_command; nothing to acted; all inputs to the other outputs.
    Raises: ValueError where the requested mode has no such number.
    """

    def __init__(self, robot: Robot, day: Day, limits: TargetLimits | None = None) -> None:
        """
        Args:
            robot: The robot.
            day: Its day.
            limits: The limits that come after it, if there are any.

        Raises:
            InputError: if the robot's joints cannot take the day's postures.
        """
        super().__init__()
        self._machine = ModeMachine(day, robot, limits)
        self._mode_state = self.DeclareDiscreteState(self._machine.initial().packed())
        self._action_port = self.DeclareVectorInputPort("action", quadruped.N_JOINTS)
        self._previous_action_port = self.DeclareVectorInputPort(
            "previous_action", quadruped.N_JOINTS
        )
        self._joints_port = self.DeclareVectorInputPort("joints", 2 * quadruped.N_JOINTS)
        self._imu_port = self.DeclareVectorInputPort("imu", N_IMU)
        self._command_port = self.DeclareVectorInputPort("command", 2)
        self._requested_mode_port = self.DeclareVectorInputPort("requested_mode", 1)
        # Four outputs and the update are of one step; the machine takes it once.
        self._step = CachedValue(
            self, "mode step", self._calc_step, {self.all_input_ports_ticket(), self.xd_ticket()}
        )
        of_step = {self._step.ticket()}
        self._asked_action_port = self.DeclareVectorOutputPort(
            name="asked_action",
            size=quadruped.N_JOINTS,
            calc=self._calc_asked_action,
            prerequisites_of_calc=of_step,
        )
        # The policy's action depends on it.
        self._served_command_port = self.DeclareVectorOutputPort(
            name="served_command",
            size=2,
            calc=self._calc_served_command,
            prerequisites_of_calc={self._command_port.ticket(), self._requested_mode_port.ticket()},
        )
        self._mode_port = self.DeclareVectorOutputPort(
            name="mode", size=1, calc=self._calc_mode, prerequisites_of_calc=of_step
        )
        self._acts_port = self.DeclareVectorOutputPort(
            name="acts", size=1, calc=self._calc_acts, prerequisites_of_calc=of_step
        )
        self._damped_port = self.DeclareVectorOutputPort(
            name="damped", size=1, calc=self._calc_damped, prerequisites_of_calc=of_step
        )
        self._acted_port = self.DeclareVectorOutputPort(
            name="acted",
            size=1,
            calc=self._calc_acted,
            prerequisites_of_calc={self.xd_ticket()},
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
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

    def get_command_input_port(self) -> InputPort:
        """Takes the operator's command."""
        return self._command_port

    def get_requested_mode_input_port(self) -> InputPort:
        """Takes the number of what the operator requests."""
        return self._requested_mode_port

    def get_asked_action_output_port(self) -> OutputPort:
        """Gives what is asked of the joints."""
        return self._asked_action_port

    def get_served_command_output_port(self) -> OutputPort:
        """Gives the command that the policy is given."""
        return self._served_command_port

    def get_mode_output_port(self) -> OutputPort:
        """Gives the number of the mode."""
        return self._mode_port

    def get_acts_output_port(self) -> OutputPort:
        """Gives whether the policy is followed."""
        return self._acts_port

    def get_damped_output_port(self) -> OutputPort:
        """Gives whether joints are damped alone."""
        return self._damped_port

    def get_acted_output_port(self) -> OutputPort:
        """Gives whether the policy was followed at the control step before."""
        return self._acted_port

    def _stored(self, context: Context) -> ModeState:
        return ModeState.unpacked(context.get_discrete_state(self._mode_state).value())

    def _requested(self, context: Context) -> IntArray:
        if not self._requested_mode_port.HasValue(context):
            return np.zeros((), dtype=np.int64)
        return np.rint(self._requested_mode_port.Eval(context)[0]).astype(np.int64)

    def _served(self, context: Context) -> Array:
        return self._machine.served(self._command_port.Eval(context), self._requested(context))

    def _calc_step(self, context: Context) -> ModeStep:
        joints = self._joints_port.Eval(context)
        position, velocity = joints[: quadruped.N_JOINTS], joints[quadruped.N_JOINTS :]
        return self._machine.step(
            self._stored(context),
            ModeReadings(position, velocity, self._imu_port.Eval(context)),
            requested=self._requested(context),
            served=self._served(context),
            action=self._action_port.Eval(context),
            before=self._previous_action_port.Eval(context),
        )

    def _calc_asked_action(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step.Eval(context).action)

    def _calc_served_command(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._served(context))

    def _calc_mode(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step.Eval(context).state.mode)])

    def _calc_acts(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step.Eval(context).acts)])

    def _calc_damped(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._step.Eval(context).damped)])

    def _calc_acted(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector([float(self._machine.acted(self._stored(context)))])

    def _latch(self, context: Context, state: State) -> None:
        after = self._step.Eval(context).state
        state.get_mutable_discrete_state(self._mode_state).SetFromVector(after.packed())
