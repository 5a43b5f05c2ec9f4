"""The deployed loop in Python: what the C of a controller has to agree with."""

from dataclasses import replace
from typing import Any

import numpy as np

from glassgait.models.arrays import Array
from glassgait.models.export.binding import (
    ACTION,
    BAD_INPUT,
    COMMAND_LIMITED,
    FOOT_HEIGHT,
    MACHINE,
    N_DAY,
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
from glassgait.models.task.contact import ContactTrust
from glassgait.models.task.day import Day
from glassgait.models.task.gait import Gait
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.imu import ImuReading
from glassgait.models.task.mode_machine import ModeMachine, ModeReadings, ModeState, restarted
from glassgait.models.task.observation import proprioception
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.reward_machine import MachineState, MachineStep, RewardMachine


class PythonController:
    """A policy with all that stands between it and sensors; it has no memory of its own.

    It calls the functions that the systems diagram and the batch simulator call.
    """

    def __init__(
        self,
        gait: Gait | GaitSwitch,
        controller: AlternatingController,
        day: Day | None = None,
    ) -> None:
        """
        Args:
            gait: The gait, whose reward machine runs, or several of which one is requested at each
                step.
            controller: One policy alone, of several gaits a `SwitchedPolicy`.
            day: The robot's day.

        Raises:
            InputError: if it has no estimator, the robot cannot take the day's postures, or it was
                made for another machine than the gait's.
        """
        if isinstance(gait, Gait):
            refuse_other_machine(controller, gait)
        self._switch = gait if isinstance(gait, GaitSwitch) else None
        self._machine = gait.machine if isinstance(gait, GaitSwitch) else RewardMachine(gait)
        self._limits = gait.gait if isinstance(gait, GaitSwitch) else gait
        self._policy = controller.policy
        self._estimator = estimator_in_loop(controller)
        self._law = controller.joint_law
        self._day = day and ModeMachine(day, controller.robot, self._law.limits)

    def initial(self) -> Array:
        """Returns what it remembers before its first step (27, or 50; of a day 16 more)."""
        odometry = N_ODOMETRY if isinstance(self._estimator, Odometry) else 0
        memory = np.zeros(N_MEMORY + odometry)
        memory[READING], memory[UNCHANGED] = ContactTrust.begin()
        memory[MACHINE] = np.ravel(self._machine.initial())
        if self._day is None:
            return memory
        return np.concatenate([memory, self._day.initial().packed()])

    def step(
        self,
        memory: Array,
        sensors: Sensors,
        command: Command,
        requested: int = 0,
        requested_mode: int = 0,
    ) -> Step:
        """Takes one step.

        Args:
            memory: What it remembers of the step before, as `Step` lays it out.
            sensors: What the robot senses now.
            command: Velocities (2; m/s, rad/s) and dwell (control steps) that are commanded; the
                nearest that the gait is made for is taken, and if one is not finite the robot is to
                step on the spot.
            requested: Number of the gait that is to run, of several.
            requested_mode: Number of what the operator requests, of a day.
        """
        within = sound_command(self._limits, command)
        if self._day is None:
            step = self._acted(memory, sensors, within, requested)
        else:
            step = self._lived(self._day, memory, sensors, within, requested, requested_mode)
        same = np.array_equal([*within.velocity, within.dwell], [*command.velocity, command.dwell])
        return step if same or step.status else step._replace(status=COMMAND_LIMITED)

    def _lived(
        self,
        day: ModeMachine,
        memory: Array,
        sensors: Sensors,
        command: Command,
        requested: int,
        requested_mode: int,
    ) -> Step:
        """Takes a step of a day. Without sound readings the day's machine alone does."""
        own, state = memory[:-N_DAY].copy(), ModeState.unpacked(memory[-N_DAY:])
        request, before = np.array(requested_mode), own[ACTION].copy()
        served = day.served(command.velocity, request)
        assert sensors.imu is not None
        readings = ModeReadings(sensors.joint_position, sensors.joint_velocity, sensors.imu)
        machine = MachineState(*own[MACHINE].astype(np.int64))
        begun = restarted(self._machine.initial(), machine, day.acted(state))
        policy_action, status = before, BAD_INPUT
        after = own
        if day.sound(readings):
            own[MACHINE] = np.ravel(begun)
            given = command._replace(velocity=served)
            after, policy_action = self._observed(own, sensors, given, requested)
            status = OK
        step = day.step(
            state,
            readings,
            requested=request,
            served=served,
            action=policy_action,
            before=before,
        )
        action = before
        if status == OK:
            action = self._within(step.action, before, sensors)
        after[ACTION] = action
        targets = self._policy.robot.joint_targets(action, limited=self._law.limited)
        whole = np.concatenate([after, step.state.packed()])
        return Step(whole, targets, status, bool(step.damped))

    def _acted(self, memory: Array, sensors: Sensors, command: Command, requested: int) -> Step:
        """Takes a step in which the policy acts."""
        after, asked = self._observed(memory, sensors, command, requested)
        action = self._within(asked, memory[ACTION], sensors)
        after[ACTION] = action
        targets = self._policy.robot.joint_targets(action, limited=self._law.limited)
        return Step(after, targets, OK)

    def _observed(
        self, memory: Array, sensors: Sensors, command: Command, requested: int
    ) -> tuple[Array, Array]:
        """Returns what is remembered after a step, but for its action, and what the policy asks for
        (12)."""
        reading, unchanged = memory[READING].astype(np.int8), memory[UNCHANGED].astype(np.int64)
        before = ContactTrust(reading, unchanged)
        trust = before.after(sensors.touching)
        height = self._expected_height(memory, sensors)
        contact = trust.believed(before.lasting(sensors.touching), height)
        sensors = replace(sensors, touching=trust.believed(sensors.touching, height))
        machine = self._step_machine(
            MachineState(*memory[MACHINE].astype(np.int64)),
            requested,
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

    def _step_machine(self, machine: MachineState, requested: int, **senses: Any) -> MachineStep:
        if self._switch is None:
            return self._machine.step(machine, **senses)
        return self._switch.step(machine, requested=np.array(requested), **senses)
