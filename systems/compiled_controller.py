"""Acts by a controller that was compiled from C."""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    InputPort,
    LeafSystem,
    OutputPort,
    State,
)

from glassgait.models.export.binding import ACTION, NO_NUMBER, LoadedController, Sensors, Step
from glassgait.models.robots import quadruped
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.day import REQUESTS
from glassgait.models.task.imu import N_IMU
from glassgait.systems.cached_value import CachedValue


class CompiledController(LeafSystem):
    """Steps a compiled controller, which holds all that stands between sensors and joint targets.

    .. pydrake_system::

        name: CompiledController
        input_ports:
        - joints
        - touching
        - command
        - commanded_dwell
        - requested_gait
        - requested_mode
        - imu
        output_ports:
        - action
        - targets
        - status
        - damped
        - mode

    Inputs: joints (24; rad, rad/s), measured positions, then velocities. touching (4, {0, 1}), FL
    FR RL RR, which feet press on the ground. command (2; m/s, rad/s), forward speed and yaw rate,
    trunk frame. commanded_dwell (1, control steps). requested_gait (1), of a controller of several
    gaits alone: the number of the gait that is to run; may stay unconnected, and then the gait that
    runs goes on. requested_mode (1), of a controller with a day alone, the number of what the
    operator requests; may stay unconnected, and is 0 then, `sit`. imu (9; rad/s, m/s, none), of a
    controller that has one alone, the reading of `ImuSensor`.
    Outputs: targets (12, rad), FL FR RL RR, hip thigh calf, of this control step. action (12), the
    same as other policies give it, 0.25 rad from the default stance a unit. status (1), 0 or the
    sum of flags that the C file lists, such as 1 where a sensor was not finite. damped (1, {0, 1}),
    of a controller with a day alone, whether joints are damped alone. mode (1), of the same alone,
    its number.
    State: the controller's memory after the previous control step (27 numbers, with odometry 50,
    of a day 16 more), latched every 20 ms (unrestricted update). Feedthrough: all inputs to all
    outputs.
    """

    def __init__(self, controller: LoadedController) -> None:
        super().__init__()
        self._controller = controller
        self._memory = self.DeclareDiscreteState(controller.initial())
        self._joints_port = self.DeclareVectorInputPort("joints", 2 * quadruped.N_JOINTS)
        self._touching_port = self.DeclareVectorInputPort("touching", quadruped.N_LEGS)
        self._command_port = self.DeclareVectorInputPort("command", 2)
        self._commanded_dwell_port = self.DeclareVectorInputPort("commanded_dwell", 1)
        self._requested_gait_port: InputPort | None = None
        if controller.n_gaits > 1:
            self._requested_gait_port = self.DeclareVectorInputPort("requested_gait", 1)
        self._requested_mode_port: InputPort | None = None
        if controller.has_day:
            self._requested_mode_port = self.DeclareVectorInputPort("requested_mode", 1)
        self._imu_port: InputPort | None = None
        if controller.has_imu:
            self._imu_port = self.DeclareVectorInputPort("imu", N_IMU)
        # All outputs and the update are of one step; the controller takes it once.
        self._step = CachedValue(
            self,
            "controller step",
            self._calc_step,
            {self.all_input_ports_ticket(), self.xd_ticket()},
        )
        of_step = {self._step.ticket()}
        self._action_port = self.DeclareVectorOutputPort(
            name="action",
            size=quadruped.N_JOINTS,
            calc=self._calc_action,
            prerequisites_of_calc=of_step,
        )
        self._targets_port = self.DeclareVectorOutputPort(
            name="targets",
            size=quadruped.N_JOINTS,
            calc=self._calc_targets,
            prerequisites_of_calc=of_step,
        )
        self._status_port = self.DeclareVectorOutputPort(
            name="status", size=1, calc=self._calc_status, prerequisites_of_calc=of_step
        )
        if controller.has_day:
            self.DeclareVectorOutputPort(
                name="damped", size=1, calc=self._calc_damped, prerequisites_of_calc=of_step
            )
            self.DeclareVectorOutputPort(
                name="mode", size=1, calc=self._calc_mode, prerequisites_of_calc=of_step
            )
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
        )

    def get_joints_input_port(self) -> InputPort:
        """Takes the measured joints."""
        return self._joints_port

    def get_touching_input_port(self) -> InputPort:
        """Takes which feet touch."""
        return self._touching_port

    def get_command_input_port(self) -> InputPort:
        """Takes forward speed and yaw rate."""
        return self._command_port

    def get_commanded_dwell_input_port(self) -> InputPort:
        """Takes the commanded iterations in a state."""
        return self._commanded_dwell_port

    def get_action_output_port(self) -> OutputPort:
        """Gives the action."""
        return self._action_port

    def get_targets_output_port(self) -> OutputPort:
        """Gives the joint targets."""
        return self._targets_port

    def get_status_output_port(self) -> OutputPort:
        """Returns the flags of what happened."""
        return self._status_port

    def _calc_step(self, context: Context) -> Step:
        command = Command(
            self._command_port.Eval(context), self._commanded_dwell_port.Eval(context)[0]
        )
        memory = context.get_discrete_state(self._memory).value()
        position, velocity = np.split(self._joints_port.Eval(context), 2)
        touching = self._touching_port.Eval(context) > 0.5
        imu = None if self._imu_port is None else self._imu_port.Eval(context)
        running, n_gaits = self._controller.gait_of(memory), self._controller.n_gaits
        return self._controller.step(
            memory,
            Sensors(position, velocity, touching, imu),
            command,
            _number(self._requested_gait_port, context, n_gaits, running),
            _number(self._requested_mode_port, context, len(REQUESTS), 0),
        )

    def _calc_action(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step.Eval(context).memory[ACTION])

    def _calc_targets(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step.Eval(context).targets)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.array([float(self._step.Eval(context).status)]))

    def _calc_damped(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.array([float(self._step.Eval(context).damped)]))

    def _calc_mode(self, context: Context, output: BasicVector) -> None:
        mode = self._controller.mode_of(self._step.Eval(context).memory)
        output.SetFromVector(np.array([float(mode)]))

    def _latch(self, context: Context, state: State) -> None:
        memory = self._step.Eval(context).memory
        state.get_mutable_discrete_state(self._memory).SetFromVector(memory)


def _number(port: InputPort | None, context: Context, count: int, default: int) -> int:
    """Returns what is requested, of so many; `NO_NUMBER` where that is none of them."""
    if port is None or not port.HasValue(context):
        return default
    number = np.rint(port.Eval(context)[0])
    return int(number) if 0 <= number < count else NO_NUMBER
