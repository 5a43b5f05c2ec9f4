"""The control step in Python, with the memory of the exported C."""

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.control import ControlStep, Memory, Sensors
from glassgait.models.estimation.contact import ContactTrust
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.export.binding import (
    ACTION,
    COMMAND_LIMITED,
    FOOT_HEIGHT,
    MACHINE,
    N_MEMORY,
    N_ODOMETRY,
    ODOMETRY,
    OK,
    READING,
    UNCHANGED,
    Step,
    unpacked_odometry,
)
from glassgait.models.policies.controller import (
    AlternatingController,
    estimator_in_loop,
    refuse_other_machine,
)
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command, sound_command
from glassgait.models.task.gait import Gait
from glassgait.models.task.reward_machine import MachineState, RewardMachine


class PythonController:
    """Takes the control steps of a policy; the caller keeps its memory, as `Step` lays it out."""

    def __init__(self, gait: Gait, controller: AlternatingController) -> None:
        """
        Raises:
            InputError: if the controller has no estimator, or was made for another machine than the
                gait's.
        """
        refuse_other_machine(controller, gait)
        self._gait, self._policy = gait, controller.policy
        self._control = ControlStep(
            controller.robot,
            RewardMachine(gait),
            controller.joint_law,
            estimator_in_loop(controller),
            self._policy.layout.imu,
        )
        self._has_odometry = isinstance(self._control.estimator, Odometry)

    def initial(self) -> Array:
        """Returns the memory before the first step (27, or 50)."""
        memory = self._packed(self._control.initial(self._policy.robot.default_stance))
        memory[ODOMETRY] = 0.0
        return memory

    def step(self, memory: Array, sensors: Sensors, command: Command) -> Step:
        """Takes one step.

        Args:
            memory: The memory after the step before.
            sensors: The present readings.
            command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded. The
                nearest command that the gait is made for is taken; where one is not finite the
                robot steps on the spot.
        """
        within = sound_command(self._gait, command)
        same = np.array_equal([*within.velocity, within.dwell], [*command.velocity, command.dwell])
        targets, after = self._control.step(self._unpacked(memory), sensors, within, self._policy)
        return Step(self._packed(after), targets, OK if same else COMMAND_LIMITED)

    def _unpacked(self, memory: Array) -> Memory | None:
        """Returns what is remembered of the step before; None at the first step."""
        control = self._control.initial(self._policy.robot.default_stance)
        odometry = control.odometry
        if self._has_odometry:
            begun, odometry = unpacked_odometry(memory[ODOMETRY])
            if not begun:
                return None
        trust = ContactTrust(memory[READING].astype(np.int8), memory[UNCHANGED].astype(np.int64))
        machine = MachineState(*memory[MACHINE].astype(np.int64))
        estimate = np.concatenate([np.zeros(3), memory[FOOT_HEIGHT]])
        return Memory(trust, machine, odometry, estimate, memory[ACTION])

    def _packed(self, memory: Memory) -> Array:
        packed = np.zeros(N_MEMORY + N_ODOMETRY * self._has_odometry)
        packed[ACTION], packed[FOOT_HEIGHT] = memory.action, memory.estimate[-quadruped.N_LEGS :]
        packed[READING], packed[UNCHANGED] = memory.trust
        packed[MACHINE] = np.ravel(memory.machine)
        if self._has_odometry:
            parts = [np.ravel(part) for part in memory.odometry]
            packed[ODOMETRY] = np.concatenate([np.ones(1), *parts])
        return packed
