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

from glassgait.models.arrays import Array
from glassgait.models.export.binding import ACTION, NO_GAIT, LoadedController, Step, sensed
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.ground import LEVEL_GROUND, Ground
from glassgait.models.task.imu import N_IMU
from glassgait.systems.cached_value import CachedValue


class CompiledController(LeafSystem):
    """Steps a compiled controller, which holds all that stands between sensors and joint targets.

    .. pydrake_system::

        name: CompiledController
        input_ports:
        - state
        - command
        - commanded_dwell
        - requested_gait
        - imu
        output_ports:
        - action
        - targets
        - status

    Inputs: state (37), the plant's, of which it reads the joints and which feet touch the ground.
    command (2; m/s, rad/s), forward speed and yaw rate, trunk frame. commanded_dwell (1, control
    steps). requested_gait (1), of a controller of several gaits alone: the number of the gait that
    is to run; may stay unconnected, and then the gait that runs goes on. imu (9; rad/s, m/s, none),
    of a controller that has one alone, the reading of `ImuSensor`.
    Outputs: targets (12, rad), FL FR RL RR, hip thigh calf, of this control step. action (12), the
    same as other policies give it, 0.25 rad from the default stance a unit. status (1), 0 or the
    sum of flags that the C file lists, such as 1 where a sensor was not finite.
    State: the controller's memory after the previous control step (23 numbers, with odometry 43),
    latched every 20 ms (unrestricted update). Feedthrough: all inputs to all outputs.
    """

    def __init__(
        self, robot: Robot, controller: LoadedController, ground: Ground = LEVEL_GROUND
    ) -> None:
        super().__init__()
        self._robot, self._controller, self._ground = robot, controller, ground
        self._memory = self.DeclareDiscreteState(controller.initial())
        self._state_port = self.DeclareVectorInputPort(
            name="state", size=quadruped.N_POSITIONS + quadruped.N_VELOCITIES
        )
        self._command_port = self.DeclareVectorInputPort("command", 2)
        self._commanded_dwell_port = self.DeclareVectorInputPort("commanded_dwell", 1)
        self._requested_gait_port: InputPort | None = None
        if controller.n_gaits > 1:
            self._requested_gait_port = self.DeclareVectorInputPort("requested_gait", 1)
        self._imu_port: InputPort | None = None
        if controller.has_imu:
            self._imu_port = self.DeclareVectorInputPort("imu", N_IMU)
        # Three outputs and the update are of one step; the controller takes it once.
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
        self.DeclarePeriodicUnrestrictedUpdateEvent(
            period_sec=CONTROL_PERIOD, offset_sec=0.0, update=self._latch
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
        imu = None if self._imu_port is None else self._imu_port.Eval(context)
        sensors = sensed(self._robot, self._state_port.Eval(context), self._ground, imu)
        requested = self._requested(context, memory)
        return self._controller.step(memory, sensors, command, requested)

    def _requested(self, context: Context, memory: Array) -> int:
        port = self._requested_gait_port
        if port is None or not port.HasValue(context):
            return self._controller.gait_of(memory)
        number = np.rint(port.Eval(context)[0])
        return int(number) if 0 <= number < self._controller.n_gaits else NO_GAIT

    def _calc_action(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step.Eval(context).memory[ACTION])

    def _calc_targets(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(self._step.Eval(context).targets)

    def _calc_status(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.array([float(self._step.Eval(context).status)]))

    def _latch(self, context: Context, state: State) -> None:
        memory = self._step.Eval(context).memory
        state.get_mutable_discrete_state(self._memory).SetFromVector(memory)
