"""The deployed loop in Python: what the C of a controller has to agree with."""

from dataclasses import replace

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.estimation.contact import ContactTrust
from glassgait.models.estimation.imu import ImuReading
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
    Sensors,
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
from glassgait.models.task.observation import proprioception
from glassgait.models.task.reward_machine import MachineState, RewardMachine


class PythonController:
    """A policy with all that stands between it and sensors; the caller keeps its memory.

    It calls the functions that the systems diagram and the batch simulator call.
    """

    def __init__(self, gait: Gait, controller: AlternatingController) -> None:
        """
        Raises:
            InputError: if the controller has no estimator, or was made for another machine than the
                gait's.
        """
        refuse_other_machine(controller, gait)
        self._gait, self._machine = gait, RewardMachine(gait)
        self._policy = controller.policy
        self._estimator = estimator_in_loop(controller)
        self._law = controller.joint_law

    def initial(self) -> Array:
        """Returns the memory before the first step (27, or 50)."""
        odometry = N_ODOMETRY if isinstance(self._estimator, Odometry) else 0
        memory = np.zeros(N_MEMORY + odometry)
        memory[READING], memory[UNCHANGED] = ContactTrust.begin()
        memory[MACHINE] = np.ravel(self._machine.initial())
        return memory

    def step(self, memory: Array, sensors: Sensors, command: Command) -> Step:
        """Takes one step.

        Args:
            memory: The memory after the step before, as `Step` lays it out.
            sensors: The present readings.
            command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded. The
                nearest command that the gait is made for is taken; where one is not finite the
                robot steps on the spot.
        """
        within = sound_command(self._gait, command)
        step = self._acted(memory, sensors, within)
        same = np.array_equal([*within.velocity, within.dwell], [*command.velocity, command.dwell])
        return step if same or step.status else step._replace(status=COMMAND_LIMITED)

    def _acted(self, memory: Array, sensors: Sensors, command: Command) -> Step:
        after, asked = self._observed(memory, sensors, command)
        action = self._within(asked, memory[ACTION], sensors)
        after[ACTION] = action
        targets = self._policy.robot.joint_targets(action, limited=self._law.limited)
        return Step(after, targets, OK)

    def _observed(self, memory: Array, sensors: Sensors, command: Command) -> tuple[Array, Array]:
        """Returns the memory after a step, except its action, and the policy's action (12)."""
        reading, unchanged = memory[READING].astype(np.int8), memory[UNCHANGED].astype(np.int64)
        before = ContactTrust(reading, unchanged)
        trust = before.after(sensors.touching)
        height = self._expected_height(memory, sensors)
        contact = trust.believed(before.lasting(sensors.touching), height)
        sensors = replace(sensors, touching=trust.believed(sensors.touching, height))
        machine = self._machine.step(
            MachineState(*memory[MACHINE].astype(np.int64)),
            foot_contact=contact,
            foot_height=memory[FOOT_HEIGHT],
            commanded_dwell=command.dwell,
        ).machine
        own = proprioception(
            self._policy.robot,
            command=command.velocity,
            joint_position=sensors.joint_position,
            joint_velocity=sensors.joint_velocity,
            previous_action=memory[ACTION],
            rm_state=self._machine.one_hot(machine.state),
            rm_iterations=machine.iterations.astype(float),
            commanded_dwell=command.dwell,
            imu=sensors.imu if self._policy.layout.imu else None,
            limited=self._law.limited,
        )
        after = np.empty(len(memory))
        match self._estimator:
            case Odometry():
                body, after[ODOMETRY] = self._measured(self._estimator, memory[ODOMETRY], sensors)
            case network:
                assert network is not None
                body = network(own)
        after[FOOT_HEIGHT] = body[-quadruped.N_LEGS :]
        after[READING], after[UNCHANGED] = trust
        after[MACHINE] = np.ravel(machine)
        return after, self._policy(np.concatenate([own, body]))

    def _within(self, action: Array, before: Array, sensors: Sensors) -> Array:
        """Returns what limits leave of an action (12), given the one before."""
        if self._law.limits is None:
            return action
        assert sensors.imu is not None
        return self._law.limits.applied(
            self._policy.robot,
            action,
            before=before,
            position=sensors.joint_position,
            gravity=ImuReading.of(sensors.imu).gravity,
        )

    def _measured(self, odometry: Odometry, memory: Array, sensors: Sensors) -> tuple[Array, Array]:
        """Advances odometry; returns the body state (7) and what odometry then remembers (23)."""
        robot, position = self._policy.robot, sensors.joint_position
        begun, state = unpacked_odometry(memory)
        if not begun:
            state = odometry.begin(robot, position)
        else:
            assert sensors.imu is not None
            state = odometry.advance(
                robot,
                state,
                joint_position=position,
                joint_velocity=sensors.joint_velocity,
                imu=sensors.imu,
                touching=sensors.touching,
            )
        kept = [np.ones(1), state.velocity, state.footholds.ravel(), state.touching, state.turning]
        return odometry.body_state(robot, state, position), np.concatenate(kept)

    def _expected_height(self, memory: Array, sensors: Sensors) -> Array:
        """Returns how high the feet are (4; m) before it is known which of them touch."""
        if not isinstance(self._estimator, Odometry):
            return memory[FOOT_HEIGHT]
        begun, before = unpacked_odometry(memory[ODOMETRY])
        if not begun:
            return np.zeros(quadruped.N_LEGS)
        robot = self._policy.robot
        return self._estimator.expected_heights(robot, before, sensors.joint_position)
